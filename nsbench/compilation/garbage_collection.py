"""No collection of garbage while numba compiles: its many objects live until a kernel is compiled.

Python's collector looks at all of them again and again, which takes an eighth of the time. What is
garbage is collected afterwards.
"""

from __future__ import annotations

import gc
import threading

from numba.core import event


class PausedCollector(event.Listener):
    """Listener to the lock under which numba compiles: the collector is off while it is held."""

    def __init__(self) -> None:
        self._counting = threading.Lock()  # threads may wait for numba's lock together
        self._depth = 0  # kernels that a kernel calls are compiled within
        self._was_on = False

    def on_start(self, event: event.Event) -> None:
        """Switch the collector off with the first of nested compilations."""
        with self._counting:
            if self._depth == 0:
                self._was_on = gc.isenabled()
                gc.disable()
            self._depth += 1

    def on_end(self, event: event.Event) -> None:
        """Switch it on again with the end of that one, if it was on."""
        with self._counting:
            self._depth -= 1
            if self._depth == 0 and self._was_on:
                gc.enable()


def pause_while_compiling() -> None:
    """Pause Python's collector whenever numba compiles in this process, from now on."""
    event.register("numba:compiler_lock", PausedCollector())
