"""Tell whoever waits at a terminal or in a notebook that kernels are being compiled.

A first call compiles for seconds, later ones and other processes load what it stored.
"""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator

_waiting_for: list[str] = []  # what the calls in progress compute, the innermost last


@contextlib.contextmanager
def announced_compilation(what: str) -> Iterator[None]:
    """Say on stderr, once, that `what` is being compiled, if it is within this context.

    Nothing is said to files and pipes. Drifts, which take less than a second, are not told.
    """
    if not _is_watched():
        yield
        return
    _waiting_for.append(what)
    try:
        yield
    finally:
        del _waiting_for[-1]


def _is_watched() -> bool:
    """Does somebody see what is written to stderr while it is written?"""
    return "ipykernel" in sys.modules or bool(getattr(sys.stderr, "isatty", bool)())


def listen() -> None:
    """Listen to numba's compilations in this process, from now on."""
    from numba.core import event

    event.register("numba:compile", _listener(event.Listener))


def _listener(base):
    class Announcer(base):
        """Listener that speaks of the first stored kernel which is compiled in a context."""

        def on_start(self, event) -> None:
            if not (_waiting_for and _waiting_for[-1]):
                return
            if getattr(getattr(event.data["dispatcher"], "_cache", None), "cache_path", None):
                what = f"compiling {_waiting_for[-1]}, once: the code is kept on disk"
                print(f"nsbench: {what} (5 to 30 s)", file=sys.stderr, flush=True)
                _waiting_for[-1] = ""

        def on_end(self, event) -> None:
            pass

    return Announcer()
