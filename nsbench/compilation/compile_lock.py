"""A kernel is compiled by one process alone: the others wait until it is on the disk, and load it.

numba looks into its cache, compiles what is not there, and writes it when it has done so: two
processes that come to one kernel together both compile it, and the second one to write the kernel's
index drops what the first one wrote. Here a file's lock is held from the look to the writing. A
kernel asks for the locks of those that it calls while it holds its own, and no two kernels call
each other, so that nobody waits in a circle. A lock goes with the process that holds it.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path


def lock_compilation(
    folder: str, around: Callable[[], AbstractContextManager], waited: Callable[[float], None]
) -> None:
    """From now on every kernel with a cache is compiled under a lock that all processes with this
    folder share.

    around() is entered while a kernel is loaded, waited for or compiled, once for a kernel and
    those it calls; waited(s) is told the seconds for which another process held the lock. Where
    files cannot be locked nothing changes, and both compile.
    """
    try:
        import fcntl
    except ImportError:
        return
    from numba.core.dispatcher import Dispatcher

    plain = Dispatcher.compile
    held = set()

    @functools.wraps(plain)
    def compile_alone(self, sig):
        name = _name(self)
        if name is None or name in held:  # nothing to share, or a kernel that calls itself
            return plain(self, sig)
        with (
            contextlib.nullcontext() if held else around(),
            open(Path(folder) / name, "ab") as file,
        ):
            start = time.perf_counter()
            fcntl.flock(file, fcntl.LOCK_EX)  # closing the file gives it back
            waited(time.perf_counter() - start)
            held.add(name)
            try:
                return plain(self, sig)
            finally:
                held.discard(name)

    Dispatcher.compile = compile_alone


def _name(dispatcher) -> str | None:
    """A word for the kernel and the place of its cache; None: it has no cache."""
    place = getattr(getattr(dispatcher, "_cache", None), "cache_path", None)
    if place is None:
        return None
    f = dispatcher.py_func
    return (
        "kernel-"
        + hashlib.sha256(f"{place} {f.__module__} {f.__qualname__}".encode()).hexdigest()[:16]
    )
