"""Compile each kernel in one process: the others wait until it is on the disk, and load it.

numba looks into its cache, compiles what is not there, and writes it when it has finished: two
processes that need one kernel at the same time both compile it, and the second one to write the
kernel's index drops what the first one wrote. Here a file lock is held from the look to the
writing. A kernel acquires the locks of those that it calls while it holds its own; no two kernels
call each other, so that no circle of waiting processes can form. The system releases the lock of a
process that ends, however it ends.
"""

from __future__ import annotations

import contextlib
import functools
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

from nsbench.compilation import disk_cache

POLL = 0.01  # seconds between two attempts to acquire a lock that another process holds


def lock_compilation(
    folder: str, around: Callable[[], AbstractContextManager], waited: Callable[[float], None]
) -> None:
    """Compile every kernel that numba caches under a lock, from now on.

    folder: of the lock files, the same for all processes. around() is entered while a kernel is
    loaded, waited for or compiled, once for a kernel and those it calls; waited(s) receives the
    seconds for which another process held the lock.
    """
    from filelock import FileLock
    from numba.core.dispatcher import Dispatcher

    plain = Dispatcher.compile
    held = set()

    @functools.wraps(plain)
    def compile_alone(self: Dispatcher, sig: tuple | str) -> Callable:
        name = _lock_name(self)
        if name is None or name in held:  # not cached, or a kernel that calls itself
            return plain(self, sig)
        with contextlib.nullcontext() if held else around():
            start = time.perf_counter()
            with FileLock(Path(folder) / name).acquire(poll_interval=POLL):
                waited(time.perf_counter() - start)
                held.add(name)
                try:
                    return plain(self, sig)
                finally:
                    held.discard(name)

    Dispatcher.compile = compile_alone


def _lock_name(dispatcher) -> str | None:
    """Return a name for the kernel and the folder of its cache; None: it has no cache."""
    folder = getattr(getattr(dispatcher, "_cache", None), "cache_path", None)
    if folder is None:
        return None
    f = dispatcher.py_func
    return f"kernel-{disk_cache.digest(str(folder), f.__module__, f.__qualname__)[:16]}"
