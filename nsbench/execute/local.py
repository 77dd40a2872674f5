"""Supervised local workers: spawned, warm, one case at a time each; killed and replaced on their time limit.

The parent never computes. A worker says what it is about to do with which run; when nothing new is heard within the
limit it is killed, the run becomes a timeout row, and the rest of its case goes to a fresh worker. A worker that dies
by itself makes its run a "crashed" row. The clock of a run starts when its preparation (compilation) has ended, and anew
after a kernel that was compiled within it; preparation and compilation have a limit of their own.
"""
from __future__ import annotations

import contextlib
import multiprocessing as mp
import os
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from multiprocessing.connection import wait
from pathlib import Path

from nsbench.execute.once import share_compilation
from nsbench.execute.turns import Turns
from nsbench.measure import clock
from nsbench.study import Spec, run_batch

PREPARE = 300.0           # seconds: compiling and factorising, beside the limit of the run itself
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


@dataclass(frozen=True)
class Chore:
    """Work without a row, done by whichever worker has nothing else to do: function(*args), both picklable."""
    function: Callable
    args: tuple = ()


def _worker(pipe, locks: str) -> None:
    """Body of a worker: batches and chores in, (what, index, row) out."""
    import signal
    signal.signal(signal.SIGINT, signal.SIG_IGN)         # the parent decides what Ctrl-C means
    turns, news = Turns(locks), _News(pipe)
    share_compilation(locks, news.compiling, clock.stand)
    while True:
        try:
            task = pipe.recv()
        except EOFError:
            return
        if task is None:
            return
        news.last = ("start", -1)
        if isinstance(task, Chore):
            pipe.send(("done", -1, _does(task)))
            continue
        for i, row in run_batch(task, news.tell, turns.order):
            pipe.send(("row", i, row))
        pipe.send(("done", -1, None))


class _News:
    """What a worker tells of itself: what it does with which run, and when a kernel is compiled on the way, for which
    the clock of the run stands still."""

    def __init__(self, pipe):
        self.pipe, self.last = pipe, ("start", -1)

    def tell(self, what: str, i: int) -> None:
        self.last = (what, i)
        self.pipe.send((what, i, None))

    @contextlib.contextmanager
    def compiling(self):
        before = self.last
        self.tell("compile", before[1])
        try:
            yield
        finally:
            self.tell(*before)


def _does(chore: Chore) -> bool:
    try:
        chore.function(*chore.args)
    except Exception:                    # who set the chore looks after those that were not done
        return False
    return True


@dataclass
class _Job:
    """A worker at work on the specs of one case, of which `missing` have no row yet, or on a chore."""
    process: mp.Process
    pipe: object
    chore: Chore | None = None
    specs: list[Spec] = field(default_factory=list)
    missing: set[int] = field(default_factory=set)
    what: str = ""
    index: int = -1
    since: float = 0.0


def _jax_cache() -> dict[str, str]:
    """Settings that keep what JAX compiles in the user's cache folder, unless the user has settings of his own."""
    folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "nsbench" / "jax"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return {}
    wanted = {"JAX_COMPILATION_CACHE_DIR": str(folder), "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
              "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1"}
    return {k: os.environ.get(k, v) for k, v in wanted.items()}


def _spawn(locks: str, threads: int) -> _Job:
    context = mp.get_context("spawn")
    ours, theirs = context.Pipe()
    ours_alone = dict.fromkeys(THREADS, str(threads)) | _jax_cache()
    keep = {k: os.environ.get(k) for k in ours_alone}
    os.environ.update(ours_alone)
    try:
        process = context.Process(target=_worker, args=(theirs, locks), daemon=True)
        process.start()
    finally:
        for k, v in keep.items():
            if v is None:
                os.environ.pop(k, None)
            else:
                os.environ[k] = v
    theirs.close()
    return _Job(process, ours)


def run_all(batches: list[list[Spec]], jobs: int, timeout: float | None, on_row: Callable[[Spec, dict], None],
            chores: Iterable[Chore] = (), threads: int = 1) -> list[Chore]:
    """Rows of all batches, handed to on_row as they come, then the chores; those that were done. KeyboardInterrupt stops
    the workers and passes on."""
    queue, working, done = [*reversed([*chores]), *reversed(batches)], [], []
    with tempfile.TemporaryDirectory(prefix="nsbench-") as locks:
        try:
            while queue or working:
                while queue and len(working) < jobs:
                    _assign(working, _spawn(locks, threads), queue.pop())
                for pipe in wait([j.pipe for j in working], timeout=0.2):
                    job = next(j for j in working if j.pipe is pipe)
                    more = _listen(job, on_row, done)
                    if more is None:
                        continue
                    working.remove(job)
                    queue += more
                    if queue and not job.pipe.closed:
                        _assign(working, job, queue.pop())
                    elif not job.pipe.closed:
                        _dismiss(job)
                for job in [j for j in working if _late(j, timeout)]:
                    working.remove(job)
                    queue += _give_up(job, timeout, on_row)
        finally:
            for job in working:
                job.process.kill()
                job.process.join()
    return done


def _assign(working, job, task):
    job.chore, job.specs = (task, []) if isinstance(task, Chore) else (None, task)
    job.missing, job.what, job.index = set(range(len(job.specs))), "start", -1
    job.since = time.monotonic()
    job.pipe.send(task)
    working.append(job)


def _listen(job, on_row, done):
    """Take one message. None: go on; a list: the worker is free, or dead, and these batches are still to do."""
    try:
        what, i, row = job.pipe.recv()
    except (EOFError, ConnectionResetError):
        job.process.join()
        rest = _lost(job, on_row, "crashed", f"The worker died with exit code {job.process.exitcode} during this run.")
        return [rest] if rest else []
    job.since = time.monotonic()
    if what == "done":
        done += [job.chore] if row else []
        return []
    if what == "row":
        job.missing.discard(i)
        on_row(job.specs[i], row)
    else:
        job.what, job.index = what, i
    return None


def _lost(job, on_row, status, why):
    """Row for the run in flight; the specs that are still to do."""
    job.pipe.close()
    i = job.index if job.index >= 0 else min(job.missing, default=-1)     # died before its first word: one run pays
    if i in job.missing:
        spec = job.specs[i]
        job.missing.discard(i)
        on_row(spec, {"case": spec.case, "solver": spec.solver, "accuracy": spec.accuracy, "asked": spec.asked,
                      "h": 1.0 / spec.asked if spec.accuracy == "k" else spec.asked, "status": status, "why": why})
    return [job.specs[k] for k in sorted(job.missing)]


def _late(job, timeout):
    limit = timeout if job.what == "run" else None if timeout is None else timeout + PREPARE
    return limit is not None and time.monotonic() - job.since > limit


def _give_up(job, timeout, on_row):
    job.process.kill()
    job.process.join()
    limit = timeout if job.what == "run" else timeout + PREPARE
    rest = _lost(job, on_row, "timeout", f"No end within {limit:g} s ({job.what}); the worker was stopped.")
    return [rest] if rest else []


def _dismiss(job):
    with contextlib.suppress(OSError):
        job.pipe.send(None)
        job.pipe.close()
    job.process.join(5)
    if job.process.is_alive():
        job.process.kill()
