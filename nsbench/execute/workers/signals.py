"""Ctrl-C, SIGTERM and a terminal that closes: the program stops in order.

Where nothing can be torn the first signal raises KeyboardInterrupt at once, otherwise it is noted
and raised at the next `check`. Signals that follow while the program cleans up change nothing, so
that a second Ctrl-C tears nothing either; after SECONDS_TO_CLEAN_UP one more ends the process where
it stands, and its workers with it.
"""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass

SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
INTERRUPTED = 130  # exit code
SECONDS_TO_CLEAN_UP = 5.0  # after the first signal, before another one ends the process
_end_process = os._exit  # the original: while a user's file is loaded os._exit raises


@dataclass
class _SignalState:
    """State of the handler.

    since: when the first signal came, by the monotonic clock; listening: is the handler installed?
    deferred: how deep `defer_signals` is nested.
    """

    since: float | None = None
    listening: bool = False
    deferred: int = 0


_state = _SignalState()


def _handle(number, frame) -> None:
    now = time.monotonic()
    if _state.since is None:
        _state.since = now
        if not _state.deferred:
            raise KeyboardInterrupt
    elif now - _state.since > SECONDS_TO_CLEAN_UP:
        _end_process(INTERRUPTED)


@contextlib.contextmanager
def stop_signals(last: bool = False) -> Iterator[None]:
    """Within, the first signal that stops a program raises KeyboardInterrupt.

    Signals that were ignored (nohup, a job in the background) stay so. last: the process ends after
    this; if it was interrupted, signals are ignored from then on. Only the main thread can install
    handlers; elsewhere, and within another `stop_signals`, nothing changes.
    """
    if _state.listening or threading.current_thread() is not threading.main_thread():
        yield
        return
    handlers = {s: signal.getsignal(s) for s in SIGNALS}
    handlers = {s: h for s, h in handlers.items() if h not in (signal.SIG_IGN, None)}
    _state.since = None
    _state.listening = True
    for s in handlers:
        signal.signal(s, _handle)
    try:
        yield
    finally:
        for s, handler in handlers.items():
            signal.signal(s, signal.SIG_IGN if last and _state.since is not None else handler)
        _state.since = None
        _state.listening = False


@contextlib.contextmanager
def defer_signals() -> Iterator[None]:
    """Within, signals are only noted; `check` is where they stop the program."""
    with stop_signals():
        _state.deferred += 1
        try:
            yield
        finally:
            _state.deferred -= 1


def check() -> None:
    """Raise KeyboardInterrupt if a signal was noted."""
    if _state.since is not None:
        raise KeyboardInterrupt
