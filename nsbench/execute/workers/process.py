"""The parent's side of one worker: start of its process, what is known of it, its end.

A worker is started with threads and caches of its own, set in the environment that it inherits.
"""

from __future__ import annotations

import contextlib
import multiprocessing as mp
import os
import signal
import time
from collections.abc import Iterator
from dataclasses import dataclass, field

from nsbench.compilation import disk_cache
from nsbench.execute.workers import memory
from nsbench.execute.workers.output_capture import OutputCapture
from nsbench.execute.workers.start import start_worker
from nsbench.execute.workers.worker import Chore
from nsbench.study import Spec

THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "NPROC",
)  # the last: XLA
SECONDS_TO_END = 5.0  # for a worker that was asked to end, or killed
SECONDS_BETWEEN_POLLS = 0.005  # of a process that is about to end
LINE_LENGTH = 200  # characters of a run's last line that are quoted


@dataclass
class Worker:
    """A worker at work on the specs of one case, or on a chore.

    missing, untimed: indices of the specs that have no row yet, or whose rows will be given again
    with the times of repetitions; phase: what the worker does ("start", "prepare", "run",
    "compile", "measure") with the run `index` (-1: no run yet), since when by the monotonic clock.
    """

    process: mp.Process
    pipe: object
    output: OutputCapture | None = None
    chore: Chore | None = None
    specs: list[Spec] = field(default_factory=list)
    missing: set[int] = field(default_factory=set)
    untimed: set[int] = field(default_factory=set)
    phase: str = ""
    index: int = -1
    since: float = 0.0
    runs_begun: int = 0  # since the process started
    peak_memory: int = 0  # bytes observed during the present run
    oom_kills_before: int = 0  # processes that the kernel had killed for memory at the start

    @property
    def current(self) -> int:
        """The run that is blamed for the worker's death: the first one if none was announced."""
        return self.index if self.index >= 0 else min(self.missing, default=-1)

    def close(self) -> None:
        """Close the pipes."""
        self.pipe.close()
        self.output.close()

    def kill(self) -> None:
        """Kill the process and what it has started, which is of its process group."""
        with contextlib.suppress(OSError, AttributeError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.kill()
        self.wait(SECONDS_TO_END)

    def wait(self, seconds: float) -> None:
        """Wait until the process has ended, at most so long.

        (Process.join waits for ever for a process that has closed its descriptors.)
        """
        end = time.monotonic() + seconds
        while self.process.exitcode is None and time.monotonic() < end:
            time.sleep(SECONDS_BETWEEN_POLLS)


def jax_cache_settings() -> dict[str, str]:
    """Settings that store what JAX compiles in the user's cache folder; the user's own go first."""
    folder = disk_cache.private_folder("jax")
    if folder is None:
        return {}
    wanted = {
        "JAX_COMPILATION_CACHE_DIR": str(folder),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
    }
    return {k: os.environ.get(k, v) for k, v in wanted.items()}


def worker_environment(threads: int) -> dict[str, str]:
    """Variables that the environment of a worker has beside those of this process."""
    return dict.fromkeys(THREADS, str(threads)) | jax_cache_settings() | {"PYTHONHASHSEED": "0"}


@contextlib.contextmanager
def _environment(variables: dict[str, str]) -> Iterator[None]:
    """Set these variables in the environment of this process, which a child inherits, for now."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def spawn_worker(locks: str, threads: int) -> Worker:
    """Start the process of a worker.

    locks: folder of lock files (nsbench.execute.workers.kernel_schedule); threads: of each library.
    """
    context = mp.get_context("spawn")
    ours, theirs = context.Pipe()
    output, printed = context.Pipe(duplex=False)
    oom_kills = memory.count_oom_kills()
    capture = OutputCapture(output)
    with theirs, printed:
        process = context.Process(
            target=start_worker,
            args=(theirs, printed, capture.word, os.getpid(), locks),
            daemon=True,
        )
        with _environment(worker_environment(threads)):
            process.start()
    return Worker(process, ours, capture, oom_kills_before=oom_kills)


def describe_end(code: int | None) -> str:
    """Describe an exit code as the end of the sentence "The worker ..."."""
    if code is None:
        return "closed its pipe and was stopped"
    if code >= 0:
        return f"died with exit code {code}"
    with contextlib.suppress(ValueError):
        return f"died of {signal.Signals(-code).name} (exit code {code})"
    return f"died of signal {-code}"


def find_last_line(text: str, words: tuple[str, ...] = ("Fatal Python error",)) -> str:
    """Find the first line with one of the words, or else the last one that is not empty.

    Returns at most LINE_LENGTH characters, without those that would move a cursor.
    """
    lines = [t for t in text.splitlines() if t.strip()]
    line = next((t for t in lines if any(w in t for w in words)), lines[-1])
    return "".join(c if c.isprintable() else "?" for c in line.strip())[:LINE_LENGTH]
