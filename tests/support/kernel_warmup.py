"""Each kernel is compiled by one process of the tests, whichever tests need it.

numba lets two processes that need one kernel compile it twice. Here a kernel is compiled under its
lock (nsbench.compilation.compile_lock), and where a whole suite is run, the processes share the
kernels of the methods among themselves first, so that none waits for another.
"""

import contextlib
from pathlib import Path

from filelock import FileLock, Timeout

import nsbench
from nsbench.compilation.compile_lock import lock_compilation

MANY_TESTS = 1000  # fewer are no whole suite: they compile what they need
# One run for each group of kernels; two that follow one another share few.
RUNS = (
    ("discs[n=10,seed=0]", "pbd", {"h": 0.1}),
    ("tide", "catching_up", {"h": 0.05}),
    ("slide_exit", "event_driven", {}),
    ("tide", "theta", {"h": 0.05}),
    ("discs[n=10,seed=0]", "event_driven", {}),
    ("epithelium[n=3]", "pbd", {"h": 0.05}),
    ("slide_exit", "euler[implicit=true]", {"h": 0.05}),
)


def compile_once(folder: Path, tests: int) -> None:
    """Compile under locks in `folder`, which all processes share, from now on."""
    folder.mkdir(exist_ok=True)
    lock_compilation(str(folder), contextlib.nullcontext, lambda seconds: None)
    for k, (case, spec, accuracy) in enumerate(RUNS if tests > MANY_TESTS else ()):
        done = folder / f"run-{k}"
        with contextlib.suppress(Timeout), FileLock(folder / f"lock-{k}").acquire(timeout=0):
            if not done.exists():
                nsbench.solve(case, spec, **accuracy)
                done.touch()
