"""Ctrl-C, SIGTERM and a terminal that closes: heard at once where nothing can be torn, else when
the piece in hand is done.

The first signal stops the program in order (KeyboardInterrupt). Those that follow while it cleans
up change nothing, so that a second Ctrl-C tears nothing either; after PATIENCE seconds one more
ends the process where it stands, and its workers with it.
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
_leave = os._exit  # as it is here: a file that is loaded is kept from it
PATIENCE = 5.0  # seconds for cleaning up, before a signal is taken as "now"


@dataclass
class _SignalState:
    """What was heard: since when, by the monotonic clock; whether signals are listened to; how deep
    `held` is nested."""

    since: float | None = None
    listening: bool = False
    held: int = 0


_ear = _SignalState()


def _hear(number, frame) -> None:
    now = time.monotonic()
    if _ear.since is None:
        _ear.since = now
        if not _ear.held:
            raise KeyboardInterrupt
    elif now - _ear.since > PATIENCE:
        _leave(INTERRUPTED)


@contextlib.contextmanager
def stop_signals(last: bool = False) -> Iterator[None]:
    """Signals that stop a program raise KeyboardInterrupt within, once. Those that are ignored
    (nohup, a job in the background) stay so. last: the process ends after this; when it was
    interrupted it hears nothing from here on."""
    if _ear.listening or threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {s: signal.getsignal(s) for s in SIGNALS}
    before = {s: h for s, h in before.items() if h not in (signal.SIG_IGN, None)}
    _ear.since = None
    _ear.listening = True
    for s in before:
        signal.signal(s, _hear)
    try:
        yield
    finally:
        for s, handler in before.items():
            signal.signal(s, signal.SIG_IGN if last and _ear.since is not None else handler)
        _ear.since = None
        _ear.listening = False


@contextlib.contextmanager
def defer_signals() -> Iterator[None]:
    """Signals are only noted within; `check` is where they stop the program."""
    with stop_signals():
        _ear.held += 1
        try:
            yield
        finally:
            _ear.held -= 1


def check() -> None:
    """Raise KeyboardInterrupt if a signal was noted."""
    if _ear.since is not None:
        raise KeyboardInterrupt
