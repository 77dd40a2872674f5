"""A worker goes with its parent: this is said before anything heavy is imported, so that it holds
from the first moment."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time

PARENT_DEATH = 1  # PR_SET_PDEATHSIG of prctl(2)
ORPHAN = 0.5  # seconds between two looks at the parent, where the kernel does not tell


def begin(pipe, printed, word: bytes, parent: int, locks: str) -> None:
    """Body of a worker's process: see nsbench.execute.workers.worker.work."""
    exit_with_parent(parent)
    from nsbench.execute.workers.worker import work

    work(pipe, printed, word, parent, locks)


def exit_with_parent(parent: int) -> None:
    """End this process when `parent` does, even in the middle of a run that never comes back to
    Python (on Linux;
    elsewhere as soon as a thread gets its turn)."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(PARENT_DEATH, signal.SIGKILL)
    elif os.name == "posix":
        threading.Thread(target=_watch, args=(parent,), daemon=True).start()
    if os.name == "posix" and os.getppid() != parent:  # it went before it could be told
        os._exit(0)


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(ORPHAN)
    os._exit(0)
