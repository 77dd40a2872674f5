"""End of a worker with its parent, in whatever way the parent ends.

On Linux the kernel kills the worker (prctl(2), PR_SET_PDEATHSIG), elsewhere with POSIX a thread
looks for the parent; with Windows a worker ends when its pipe closes, between two runs.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time

PR_SET_PDEATHSIG = 1  # option of prctl(2)
SECONDS_BETWEEN_CHECKS = 0.5  # of the parent, where the kernel does not report its end


def exit_with_parent(parent: int) -> None:
    """End this process when the process `parent` ends.

    On Linux that holds in the middle of a run that never comes back to Python; elsewhere it happens
    as soon as a thread gets its turn.
    """
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    elif os.name == "posix":
        threading.Thread(target=_watch_parent, args=(parent,), daemon=True).start()
    if os.name == "posix" and os.getppid() != parent:  # it ended before the watch began
        os._exit(0)


def _watch_parent(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(SECONDS_BETWEEN_CHECKS)
    os._exit(0)
