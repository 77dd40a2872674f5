"""The parent's side of one worker: its process, started with threads and caches of its own, what is
known of it, its end."""

from __future__ import annotations

import contextlib
import multiprocessing as mp
import os
import signal
import time
from dataclasses import dataclass, field

from nsbench.compilation import disk_cache
from nsbench.execute.workers import memory
from nsbench.execute.workers.output_capture import OutputCapture
from nsbench.execute.workers.parent_watch import begin
from nsbench.execute.workers.worker import Chore
from nsbench.study import Spec

THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "NPROC",
)  # the last: XLA
LEAVING = 5.0  # seconds for a worker to end that was told to


@dataclass
class Worker:
    """A worker at work on the specs of one case, of which `missing` have no row yet, or on a
    chore."""

    process: mp.Process
    pipe: object
    printed: OutputCapture | None = None
    chore: Chore | None = None
    specs: list[Spec] = field(default_factory=list)
    missing: set[int] = field(default_factory=set)
    untimed: set[int] = field(
        default_factory=set
    )  # their rows will be given again, with the times of repetitions
    what: str = ""
    index: int = -1
    since: float = 0.0
    begun: int = 0  # runs since the process started
    peak: int = 0  # bytes it was seen to hold during the present run
    kills: int = 0  # of the system for want of memory, before this process started

    @property
    def current(self) -> int:
        """The run that pays for the worker's death: one that died before its first word has not
        told which."""
        return self.index if self.index >= 0 else min(self.missing, default=-1)

    def close(self) -> None:
        self.pipe.close()
        self.printed.close()

    def kill(self) -> None:
        with contextlib.suppress(OSError, AttributeError):  # what it has started is of its group
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.kill()
        self.wait(LEAVING)

    def wait(self, seconds: float) -> None:
        """Until the process has ended, or so long. (Process.join waits for ever for one that has
        closed its descriptors.)"""
        end = time.monotonic() + seconds
        while self.process.exitcode is None and time.monotonic() < end:
            time.sleep(0.005)


def jax_cache() -> dict[str, str]:
    """Settings that keep what JAX compiles in the user's cache folder, unless the user has settings
    of his own."""
    folder = disk_cache.private_folder("jax")
    if folder is None:
        return {}
    wanted = {
        "JAX_COMPILATION_CACHE_DIR": str(folder),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
    }
    return {k: os.environ.get(k, v) for k, v in wanted.items()}


def settings(threads: int) -> dict[str, str]:
    """What the environment of a worker says beyond this one's."""
    return dict.fromkeys(THREADS, str(threads)) | jax_cache() | {"PYTHONHASHSEED": "0"}


def spawn(locks: str, threads: int) -> Worker:
    context = mp.get_context("spawn")
    (ours, theirs), (output, printed) = context.Pipe(), context.Pipe(duplex=False)
    ours_alone = settings(threads)
    keep = {k: os.environ.get(k) for k in ours_alone}
    os.environ.update(ours_alone)
    kills = memory.kernel_kills()
    ear = OutputCapture(output)
    try:
        process = context.Process(
            target=begin, args=(theirs, printed, ear.word, os.getpid(), locks), daemon=True
        )
        process.start()
    finally:
        for k, v in keep.items():
            if v is None:
                os.environ.pop(k, None)
            else:
                os.environ[k] = v
    theirs.close()
    printed.close()
    return Worker(process, ours, ear, kills=kills)


def ended(code: int | None) -> str:
    if code is None:
        return "closed its pipe and was stopped"
    if code >= 0:
        return f"died with exit code {code}"
    with contextlib.suppress(ValueError):
        return f"died of {signal.Signals(-code).name} (exit code {code})"
    return f"died of signal {-code}"


def last_line(text: str, words: tuple[str, ...] = ("Fatal Python error",)) -> str:
    """Of what a run wrote last the first line with one of the words, else the last line that says
    something; without what would move a cursor, at most 200 characters."""
    lines = [t for t in text.splitlines() if t.strip()]
    line = next((t for t in lines if any(w in t for w in words)), lines[-1])
    return "".join(c if c.isprintable() else "?" for c in line.strip())[:200]
