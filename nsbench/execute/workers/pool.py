"""Pool of supervised local workers: one case at a time each, killed and replaced on their limits.

Workers are spawned once and stay warm.

The parent never computes. A worker announces what it is about to do with which run; when nothing
new is received within the limit it is killed, the run becomes a timeout row, and the rest of its
case goes to a fresh worker. A worker that uses more memory than it may makes its run an "oom" row,
one that dies by itself a "crashed" one. The clock of a run starts when its preparation
(compilation) has ended, and anew after a kernel that was compiled within it; preparation and
compilation have a limit of their own. Nothing that a worker or its run does (dying half way through
a message, closing its descriptors, printing without end) stops the parent or the other workers.
"""

from __future__ import annotations

import contextlib
import signal
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from multiprocessing.connection import wait

from nsbench.case import size
from nsbench.execute.workers import memory, signals
from nsbench.execute.workers.output_capture import NO_RUN
from nsbench.execute.workers.process import (
    SECONDS_TO_END,
    Worker,
    describe_end,
    find_last_line,
    spawn_worker,
)
from nsbench.execute.workers.worker import Chore, LostChore
from nsbench.results.row_reuse import ANOTHER_RUN, row_mismatch
from nsbench.study import Spec
from nsbench.study.attempt import REPEATED, lost_run_row

PREPARATION_LIMIT = 300.0  # seconds: compiling and factorising, beside the limit of the run itself
SECONDS_BETWEEN_CHECKS = 0.1  # of the limits
SECONDS_BETWEEN_COUNTS = 1.0  # of the processes that the workers have started
# seconds without a check: this process was stopped, or waited for its disk, and received nothing
LONG_PAUSE = 2.0
SECONDS_TO_LOAD = 1.0  # of a kernel that is stored on the disk: longer than that it is compiled
SECONDS_TO_DIE = 1.0  # for a worker whose pipe has closed
MAX_BATCH = 1000  # specs: more of one case are several batches, which several workers can take

OnRow = Callable[[Spec, dict], None]
OnOutput = Callable[[Spec, bytes], None]
OnChore = Callable[[Chore, object, Exception | None], None]


def run_all(
    batches: list[list[Spec]],
    jobs: int,
    timeout: float | None,
    on_row: OnRow,
    chores: Iterable[Chore] = (),
    threads: int = 1,
    memory_limit: int | None = None,
    on_output: OnOutput = lambda spec, text: None,
    on_pause: Callable[[], None] = lambda: None,
    on_compile: Callable[[Spec], None] = lambda spec: None,
) -> list[Chore]:
    """Run all batches on `jobs` workers, then the chores; returns the chores that were done.

    timeout: seconds of one run (None: no limit); on_row is called with each row as it comes, twice
    for a run that is repeated for its times; threads: of every library in each worker;
    memory_limit:
    bytes that a worker may use (None: its share of the machine); on_output is called with what a
    run has printed, if anything, before on_row; on_pause is called between the rows, and every
    SECONDS_BETWEEN_CHECKS where none comes, and on_compile with each run that has waited for a
    kernel longer than a stored one takes to load. A signal that stops the program takes effect
    between two rows: the workers are stopped and KeyboardInterrupt passes on.
    """
    batches = [b[k : k + MAX_BATCH] for b in batches for k in range(0, len(b), MAX_BATCH)]
    pool = WorkerPool(
        queue=[*reversed([*chores]), *reversed(batches)],
        timeout=timeout,
        on_row=on_row,
        on_output=on_output,
        threads=threads,
        memory_limit=memory_limit or memory.worker_limit(jobs),
    )
    with (
        signals.defer_signals(),
        tempfile.TemporaryDirectory(prefix="nsbench-", ignore_cleanup_errors=True) as pool.locks,
    ):
        try:
            while pool.queue or pool.queue_alone or pool.busy:
                signals.check()
                pool.start_workers(jobs)
                pool.receive()
                pool.enforce_limits()
                on_pause()
                for spec in pool.compiling():
                    on_compile(spec)
        finally:
            pool.stop()
    return pool.chores_done


@dataclass
class WorkerPool:
    """The workers and what is still to do.

    queue: batches and chores for any worker, the last one first; queue_alone: batches that each
    need a fresh worker; locks: folder of lock files; on_chore: called with each chore, its value
    and what it raised; busy, idle, leaving: workers at work, without work (only with keep_idle),
    and asked to end (with the time of that).
    """

    queue: list
    timeout: float | None
    on_row: OnRow | None
    on_output: OnOutput | None
    threads: int
    memory_limit: int
    locks: str = ""
    start_process: Callable[[str, int], Worker] = spawn_worker
    keep_idle: bool = False
    on_chore: OnChore = lambda chore, value, error: None
    queue_alone: list = field(default_factory=list)
    busy: list[Worker] = field(default_factory=list)
    idle: list[Worker] = field(default_factory=list)
    leaving: list[tuple[float, Worker]] = field(default_factory=list)
    chores_done: list[Chore] = field(default_factory=list)
    tried_alone: set[Spec] = field(default_factory=set)  # after the first one ran out of memory
    # whose worker died between their first run and the repetitions: they are timed once more
    timed_again: set[Spec] = field(default_factory=set)
    checked_at: float = field(default_factory=time.monotonic)
    counted_at: float = 0.0

    def start_workers(self, jobs: int) -> None:
        """Start workers for what is to do, until `jobs` of them are at work."""
        while (self.queue or self.queue_alone) and len(self.busy) < jobs:
            worker = None if self.queue_alone else self.take_idle()
            worker = worker or self.start_process(self.locks, self.threads)
            self.assign(worker, (self.queue_alone or self.queue).pop())

    def compiling(self) -> list[Spec]:
        """Return the runs whose kernels are being compiled for longer than SECONDS_TO_LOAD."""
        start = time.monotonic() - SECONDS_TO_LOAD
        busy = (w for w in self.busy if w.phase == "compile" and w.since < start)
        return [w.specs[w.index] for w in busy if w.index in range(len(w.specs))]

    def take_idle(self) -> Worker | None:
        """Take a worker without work that has not ended; None if there is none."""
        while self.idle:
            worker = self.idle.pop()
            if worker.process.exitcode is None:
                return worker
            worker.close()
        return None

    def assign(self, worker: Worker, task: list[Spec] | Chore) -> None:
        """Send a batch or a chore to a worker."""
        is_chore = isinstance(task, Chore)
        worker.chore = task if is_chore else None
        worker.specs = [] if is_chore else task
        worker.missing = set(range(len(worker.specs)))
        worker.untimed = set()
        worker.phase = "start"
        worker.index = -1
        worker.peak_memory = 0
        worker.since = time.monotonic()
        self.busy.append(worker)
        # it may have died meanwhile: then its pipe is closed, which will be noticed
        with contextlib.suppress(OSError):
            worker.pipe.send(task)

    def receive(self) -> None:
        """Wait for workers a short while; take one message of each, and all they have printed."""
        outputs = [w.output for w in self.busy if w.output.open]
        ready = wait([*(w.pipe for w in self.busy), *outputs], timeout=SECONDS_BETWEEN_CHECKS)
        signals.check()  # a signal that stopped this process may have killed the workers as well
        for worker in [*self.busy]:
            if worker.output in ready:
                worker.output.drain()
            if worker.pipe in ready:
                self.receive_message(worker)

    def receive_message(self, worker: Worker) -> None:
        """Take one message of a worker; one that cannot be read counts as its death."""
        try:
            what, i, row = worker.pipe.recv()
        except Exception:  # closed, within a message, or a run has written into the pipe itself
            self.handle_death(worker)
            return
        worker.since = time.monotonic()
        if what == "done":
            self.finish_task(worker, row)
        elif what in ("first", "row"):
            known = i in range(len(worker.specs))
            mismatch = row_mismatch(worker.specs[i], row) if known else "no such run"
            if mismatch:  # a process that a run has started may answer as well
                worker.kill()
                self.record_failure(worker, "crashed", f"{ANOTHER_RUN}: {mismatch}.")
                return
            self.record_row(worker, i, row)
            (worker.untimed.add if what == "first" else worker.untimed.discard)(i)
        else:
            worker.phase = what
            worker.index = i
            if what == "prepare":
                worker.runs_begun += 1
                worker.peak_memory = 0

    def finish_task(self, worker: Worker, outcome: tuple[object, Exception | None] | None) -> None:
        """Give the next task to a worker that has done its own, or let it go.

        outcome: value and exception of a chore.
        """
        self.busy.remove(worker)
        chore = worker.chore
        if self.queue:
            self.assign(worker, self.queue.pop())
        elif self.keep_idle:
            self.idle.append(worker)
        else:
            self.release(worker)
        if chore is not None:
            value, error = outcome
            if error is None:
                self.chores_done.append(chore)
            self.on_chore(chore, value, error)

    def record_row(self, worker: Worker, i: int, row: dict) -> None:
        """Hand on a row, and before a first one what its run has printed."""
        text = worker.output.take(i)
        if i in worker.missing:  # else it is given again, with its times
            worker.missing.discard(i)
            if text:
                self.on_output(worker.specs[i], text)
        self.on_row(worker.specs[i], row)

    def enforce_limits(self) -> None:
        """Check memory, time and life of every worker, if the last check is long enough ago."""
        now = time.monotonic()
        pause = now - self.checked_at
        if pause < SECONDS_BETWEEN_CHECKS:
            return
        if pause > LONG_PAUSE:  # what the workers have sent meanwhile was not received
            for worker in self.busy:
                worker.since = min(now, worker.since + pause)
        self.checked_at = now
        started: dict[int, list[int]] = {}
        if now - self.counted_at > SECONDS_BETWEEN_COUNTS:
            self.counted_at = now
            started = memory.started_processes(w.process.pid for w in self.busy)
        for worker in [*self.busy]:
            self._enforce_limits_of(worker, started.get(worker.process.pid, []), now)
        for since, worker in [*self.leaving]:
            if worker.process.exitcode is not None or now - since > SECONDS_TO_END:
                self.leaving.remove((since, worker))
                worker.kill()
                worker.output.close()
            else:
                worker.output.drain()

    def _enforce_limits_of(self, worker: Worker, started: list[int], now: float) -> None:
        """Kill a worker that is beyond a limit; started: the processes that it has started."""
        used = memory.resident_memory(worker.process.pid, started)
        worker.peak_memory = max(worker.peak_memory, used)
        if worker.peak_memory > self.memory_limit:
            worker.kill()
            who = "The worker and what it has started" if started else "The worker"
            self.record_memory_excess(
                worker,
                f"{who} held {size.memory(worker.peak_memory)}, its limit is "
                f"{size.memory(self.memory_limit)} (--memory); it was stopped.",
            )
        elif worker.pipe.poll():
            return  # it has sent something that was not received yet
        elif worker.process.exitcode is not None:  # what it has started keeps its pipe open
            self.handle_death(worker)
        elif (limit := exceeded_limit(worker, self.timeout, now)) is not None:
            worker.kill()
            self.record_failure(
                worker,
                "timeout",
                f"No end within {limit:g} s ({worker.phase}); the worker was stopped.",
                limit=limit,
            )

    def handle_death(self, worker: Worker) -> None:
        """Find out why a worker has ended, and record its run as "oom" or "crashed"."""
        worker.wait(SECONDS_TO_DIE)
        code = worker.process.exitcode
        worker.kill()  # if it only closed its pipe; and what it has started
        if code is not None and -code in signals.SIGNALS:
            # the signal may be for this process as well, from someone who stops all of them
            time.sleep(2 * SECONDS_BETWEEN_CHECKS)
        signals.check()
        output = worker.output.take(worker.index if worker.index in worker.missing else NO_RUN)
        text = output.decode("utf-8", "replace")
        if code == -signal.SIGKILL and (
            memory.count_oom_kills() > worker.oom_kills_before
            or worker.peak_memory > memory.SUSPICIOUS_SHARE * self.memory_limit
        ):
            why = (
                "The system stopped the worker for want of memory; it was last seen to hold "
                f"{size.memory(worker.peak_memory)}."
            )
            self.record_memory_excess(worker, why, output)
        elif code is not None and code != 0 and memory.mentions_shortage(text):
            line = find_last_line(text, memory.SHORTAGE_WORDS)
            why = f"The worker {describe_end(code)} for want of memory: {line}"
            self.record_memory_excess(worker, why, output)
        else:
            printed = f" The last it printed: {find_last_line(text)}" if text.strip() else ""
            why = f"The worker {describe_end(code)} during this run.{printed}"
            self.record_failure(worker, "crashed", why, output)

    def record_memory_excess(self, worker: Worker, why: str, output: bytes = b"") -> None:
        """Record an "oom" row, or try the run once more in a process of its own.

        A run that followed others in its process is tried again: these may have left much behind.
        """
        i = worker.current
        followed_others = i in worker.missing | worker.untimed and worker.runs_begun > 1
        if followed_others and worker.specs[i] not in self.tried_alone:
            self.tried_alone.add(worker.specs[i])
            self.queue_alone.append([worker.specs[i]])
            worker.missing.discard(i)
            worker.untimed.discard(i)
        self.record_failure(worker, "oom", why, output)

    def record_failure(
        self, worker: Worker, status: str, why: str, output: bytes = b"", **columns
    ) -> None:
        """Record the run in progress, be it a repetition, as failed; queue the rest of the batch.

        output: what the run has printed, if that was taken already; columns: more of the row.
        """
        self.busy.remove(worker)
        output = output or worker.output.take(worker.index)
        i = worker.current
        worker.close()
        repeated = i in worker.untimed and (worker.phase != "measure" or len(worker.specs) == 1)
        if i in worker.missing or repeated:
            spec = worker.specs[i]
            worker.missing.discard(i)
            worker.untimed.discard(i)
            if output:
                self.on_output(spec, output)
            sentence = f"{REPEATED}. {why}" if repeated else why
            self.on_row(spec, lost_run_row(spec, status, sentence) | columns)
        self.queue_for_timing([worker.specs[k] for k in sorted(worker.untimed)])
        if worker.missing:
            self.queue.append([worker.specs[k] for k in sorted(worker.missing)])
        if worker.chore is not None:
            name = getattr(worker.chore.function, "__qualname__", "a function")
            self.on_chore(worker.chore, None, LostChore(f"{name} was not done. {why}"))

    def queue_for_timing(self, specs: list[Spec]) -> None:
        """Queue runs whose repetitions died with their worker.

        They are timed once more together; those that were so already, each by itself.
        """
        together = [s for s in specs if s not in self.timed_again]
        self.queue += [[s] for s in specs if s in self.timed_again]
        if together:
            self.queue.append(together)
        self.timed_again |= {*together}

    def release(self, worker: Worker) -> None:
        """Ask a worker to end."""
        with contextlib.suppress(OSError):
            worker.pipe.send(None)
        worker.pipe.close()
        self.leaving.append((time.monotonic(), worker))

    def stop(self) -> None:
        """Kill all workers; those that were asked to end get the rest of their time."""
        for worker in (*self.busy, *self.idle):
            worker.kill()
            worker.close()
        for since, worker in self.leaving:
            while worker.process.exitcode is None and time.monotonic() - since < SECONDS_TO_END:
                worker.output.drain()  # it may have more to print than its pipe holds
                worker.wait(SECONDS_BETWEEN_CHECKS)
            worker.kill()
            worker.output.close()


def exceeded_limit(worker: Worker, timeout: float | None, now: float) -> float | None:
    """The limit in seconds that the phase of a worker has exceeded; None if it has not."""
    if timeout is None:
        return None
    limit = timeout if worker.phase == "run" else timeout + PREPARATION_LIMIT
    return limit if now - worker.since > limit else None
