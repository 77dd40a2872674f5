"""Tell whoever waits at a terminal or in a notebook that kernels are being compiled.

A first call compiles for seconds, later ones and other processes load what it stored.
"""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

from nsbench.source_files.locations import is_in_package


class _Waiting(threading.local):
    """What the calls of a thread compute, the innermost last; "" where it was announced."""

    def __init__(self) -> None:
        self.calls: list[str] = []


_waiting = _Waiting()


@contextlib.contextmanager
def announced_compilation(what: str) -> Iterator[None]:
    """Say on stderr, once, that `what` is being compiled, if it is within this context.

    Nothing is said to files and pipes. Drifts, which take less than a second, are not told.
    """
    if not is_watched():
        yield
        return
    _waiting.calls.append(what)
    try:
        yield
    finally:
        del _waiting.calls[-1]


def is_watched() -> bool:
    """Does somebody see what is written to stderr while it is written?"""
    if sys.stderr is None:
        return False
    try:
        return "ipykernel" in sys.modules or bool(sys.stderr.isatty())
    except Exception:  # closed, or no file at all
        return False


def listen() -> None:
    """Listen to numba's compilations in this process, from now on."""
    from numba.core import event

    event.register("numba:compile", _listener(event.Listener))


def _listener(base):
    class Announcer(base):
        """Listener that speaks of the first stored kernel which is compiled in a context."""

        def on_start(self, event) -> None:
            # a stream that cannot be written to is no reason to compile nothing
            with contextlib.suppress(Exception):
                _announce(event.data["dispatcher"])

        def on_end(self, event) -> None:
            pass

    return Announcer()


def _announce(kernel):
    calls = _waiting.calls
    stored = getattr(getattr(kernel, "_cache", None), "cache_path", None)
    if not (calls and calls[-1] and stored):
        return
    if is_in_package(Path(kernel.py_func.__code__.co_filename).resolve()):
        what = f"compiling {calls[-1]}, once: the code is kept on disk"
        calls[-1] = ""
        print(f"nsbench: {what} (5 to 30 s)", file=sys.stderr, flush=True)
