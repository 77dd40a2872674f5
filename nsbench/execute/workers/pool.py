"""Supervised local workers: spawned, warm, one case at a time each; killed and replaced on their
limits.

The parent never computes. A worker says what it is about to do with which run; when nothing new is
heard within the limit it is killed, the run becomes a timeout row, and the rest of its case goes to
a fresh worker. A worker that holds more memory than it may makes its run an "oom" row, one that
dies by itself a "crashed" one. The clock of a run starts when its preparation (compilation) has
ended, and anew after a kernel that was compiled within it; preparation and compilation have a limit
of their own. Nothing that a worker or its run does (dying half way through a message, closing its
descriptors, printing without end) stops the parent or the other workers.
"""

from __future__ import annotations

import contextlib
import signal
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from multiprocessing.connection import wait

from nsbench.execute.workers import memory, signals
from nsbench.execute.workers.output_capture import NOBODY
from nsbench.execute.workers.process import LEAVING, Worker, ended, last_line, spawn
from nsbench.execute.workers.worker import Chore
from nsbench.results.row_reuse import ANOTHER_RUN, row_mismatch
from nsbench.study import Spec
from nsbench.study.attempt import REPEATED, lost_run_row

PREPARE = 300.0  # seconds: compiling and factorising, beside the limit of the run itself
TICK = 0.1  # seconds between two looks at limits
COUNT = 1.0  # seconds between two looks at what the workers have started
# seconds without a look: this process was stopped, or waited for its disk, and heard nobody
JUMP = 2.0
GONE = 1.0  # seconds for a worker to end whose pipe has closed
BATCH = 1000  # specs: more of one case are several batches, which several workers can take

OnOutput = Callable[[Spec, bytes], None]


def run_all(
    batches: list[list[Spec]],
    jobs: int,
    timeout: float | None,
    on_row: Callable[[Spec, dict], None],
    chores: Iterable[Chore] = (),
    threads: int = 1,
    most: int | None = None,
    on_output: OnOutput = lambda spec, text: None,
) -> list[Chore]:
    """Rows of all batches, handed to on_row as they come, then the chores; those that were done.

    timeout: seconds of one run (None: no limit); threads: of every library in each worker; most:
    bytes that a worker may hold (None: its share of the machine); on_output is told what a run has
    printed, if anything, before on_row. A signal that stops the program takes effect between two
    rows: the workers are stopped and KeyboardInterrupt passes on.
    """
    batches = [b[k : k + BATCH] for b in batches for k in range(0, len(b), BATCH)]
    team = WorkerPool(
        [*reversed([*chores]), *reversed(batches)],
        timeout,
        on_row,
        on_output,
        threads,
        most or memory.limit(jobs),
    )
    with (
        signals.defer_signals(),
        tempfile.TemporaryDirectory(prefix="nsbench-", ignore_cleanup_errors=True) as team.locks,
    ):
        try:
            while team.queue or team.alone or team.working:
                signals.check()
                team.hire(jobs)
                team.hear()
                team.look()
        finally:
            team.end()
    return team.done


@dataclass
class WorkerPool:
    """The workers, and what is still to do: `queue` by anyone, last one first; `alone` by a fresh
    worker."""

    queue: list
    timeout: float | None
    on_row: Callable[[Spec, dict], None]
    on_output: OnOutput
    threads: int
    most: int
    locks: str = ""
    alone: list = field(default_factory=list)
    working: list[Worker] = field(default_factory=list)
    leaving: list[tuple[float, Worker]] = field(default_factory=list)
    done: list[Chore] = field(default_factory=list)
    again: set[Spec] = field(default_factory=set)
    timed: set[Spec] = field(
        default_factory=set
    )  # more than once, the worker of the first time being gone
    looked: float = field(default_factory=time.monotonic)
    counted: float = 0.0
    spawn: Callable[[str, int], Worker] = spawn
    keep: bool = False  # a worker without work waits in `spare`
    spare: list[Worker] = field(default_factory=list)

    def hire(self, jobs: int) -> None:
        while (self.queue or self.alone) and len(self.working) < jobs:
            self.assign(self.spawn(self.locks, self.threads), (self.alone or self.queue).pop())

    def assign(self, job: Worker, task) -> None:
        job.chore, job.specs = (task, []) if isinstance(task, Chore) else (None, task)
        job.missing = set(range(len(job.specs)))
        job.what = "start"
        job.index = -1
        job.peak = 0
        job.since = time.monotonic()
        job.untimed = set()
        self.working.append(job)
        with contextlib.suppress(
            OSError
        ):  # it died meanwhile: it will be seen that its pipe is closed
            job.pipe.send(task)

    def hear(self) -> None:
        """Take what workers say; one message of each."""
        outputs = [j.printed for j in self.working if j.printed.open]
        ready = wait([*(j.pipe for j in self.working), *outputs], timeout=TICK)
        signals.check()  # what stopped this process may have met the workers as well
        for job in [*self.working]:
            if job.printed in ready:
                job.printed.drain()
            if job.pipe in ready:
                self.listen(job)

    def listen(self, job: Worker) -> None:
        try:
            what, i, row = job.pipe.recv()
        except (
            Exception
        ):  # closed, in the middle of a message, or a run has written into the pipe itself
            self.died(job)
            return
        job.since = time.monotonic()
        if what == "done":
            self.done += [job.chore] if row else []
            self.working.remove(job)
            if self.queue:
                self.assign(job, self.queue.pop())
            elif self.keep:
                self.spare.append(job)
            else:
                self.dismiss(job)
        elif what in ("first", "row"):
            mismatch = row_mismatch(job.specs[i], row) if i in range(len(job.specs)) else "no such"
            if mismatch:  # a process that a run has started may answer as well
                job.kill()
                self.give_up(job, "crashed", f"{ANOTHER_RUN}: {mismatch}.")
                return
            self.row(job, i, row)
            (job.untimed.add if what == "first" else job.untimed.discard)(i)
        else:
            job.what = what
            job.index = i
            if what == "prepare":
                job.begun = job.begun + 1
                job.peak = 0

    def row(self, job: Worker, i: int, row: dict) -> None:
        text = job.printed.take(i)
        if i in job.missing:  # else it is given again, with its times
            job.missing.discard(i)
            if text:
                self.on_output(job.specs[i], text)
        self.on_row(job.specs[i], row)

    def look(self) -> None:
        """Who is beyond a limit, or gone without a word?"""
        now = time.monotonic()
        if now - self.looked < TICK:
            return
        if now - self.looked > JUMP:
            for job in self.working:
                job.since = min(now, job.since + now - self.looked)
        self.looked = now
        started = {}
        if now - self.counted > COUNT:
            self.counted, started = now, memory.started_by(j.process.pid for j in self.working)
        for job in [*self.working]:
            others = started.get(job.process.pid, [])
            job.peak = max(job.peak, memory.held_by(job.process.pid, others))
            if job.peak > self.most:
                job.kill()
                who = "The worker and what it has started" if others else "The worker"
                self.too_large(
                    job,
                    f"{who} held {memory.told(job.peak)}, its limit is {memory.told(self.most)} "
                    f"(--memory); "
                    "it was stopped.",
                )
            elif job.pipe.poll():
                continue  # it has said something that was not heard yet
            elif job.process.exitcode is not None:  # what it has started holds its pipe open
                self.died(job)
            elif (limit := _beyond(job, self.timeout, now)) is not None:
                job.kill()
                self.give_up(
                    job,
                    "timeout",
                    f"No end within {limit:g} s ({job.what}); the worker was stopped.",
                    limit=limit,
                )
        for since, job in [*self.leaving]:
            if job.process.exitcode is not None or now - since > LEAVING:
                self.leaving.remove((since, job))
                job.kill()
                job.printed.close()
            else:
                job.printed.drain()

    def died(self, job: Worker) -> None:
        job.wait(GONE)
        code = job.process.exitcode
        job.kill()  # if it only closed its pipe; and what it has started
        if (
            code is not None and -code in signals.SIGNALS
        ):  # sent to this process as well, by who stops all of us?
            time.sleep(2 * TICK)
        signals.check()
        text = job.printed.take(job.index if job.index in job.missing else NOBODY)
        last = text.decode("utf-8", "replace")
        if code == -signal.SIGKILL and (
            memory.kernel_kills() > job.kills or job.peak > memory.NEAR * self.most
        ):
            self.too_large(
                job,
                "The system stopped the worker for want of memory; it was last seen to hold "
                f"{memory.told(job.peak)}.",
                text,
            )
        elif code is not None and code != 0 and memory.ran_out(last):
            self.too_large(
                job,
                f"The worker {ended(code)} for want of memory: {last_line(last, memory.WORDS)}",
                text,
            )
        else:
            said = f" The last it printed: {last_line(last)}" if last.strip() else ""
            self.give_up(job, "crashed", f"The worker {ended(code)} during this run.{said}", text)

    def too_large(self, job: Worker, why: str, text: bytes = b"") -> None:
        """A run that followed others in its process is tried once more in a process of its own:
        they may have left much."""
        i = job.current
        if i in job.missing | job.untimed and job.begun > 1 and job.specs[i] not in self.again:
            self.again.add(job.specs[i])
            self.alone.append([job.specs[i]])
            job.missing.discard(i)
            job.untimed.discard(i)
        self.give_up(job, "oom", why, text)

    def give_up(self, job: Worker, status: str, why: str, text: bytes = b"", **more) -> None:
        """Row for the run in flight, be it a repetition; what is still to do or to be timed goes to
        others. text: what it has printed."""
        self.working.remove(job)
        text = text or job.printed.take(job.index)
        i = job.current
        job.close()
        repeated = i in job.untimed and (job.what != "measure" or len(job.specs) == 1)
        if i in job.missing or repeated:
            spec = job.specs[i]
            job.missing.discard(i)
            job.untimed.discard(i)
            if text:
                self.on_output(spec, text)
            self.on_row(
                spec, lost_run_row(spec, status, f"{REPEATED}. {why}" if repeated else why) | more
            )
        self.time_again([job.specs[k] for k in sorted(job.untimed)])
        if job.missing:
            self.queue.append([job.specs[k] for k in sorted(job.missing)])

    def time_again(self, specs: list[Spec]) -> None:
        """Their worker is gone, and with it the times of their repetitions: once more side by side,
        then each by itself."""
        together = [s for s in specs if s not in self.timed]
        self.queue += [[s] for s in specs if s in self.timed] + ([together] if together else [])
        self.timed |= {*together}

    def dismiss(self, job: Worker) -> None:
        with contextlib.suppress(OSError):
            job.pipe.send(None)
        job.pipe.close()
        self.leaving.append((time.monotonic(), job))

    def end(self) -> None:
        for job in (*self.working, *self.spare):
            job.kill()
            job.close()
        for since, job in self.leaving:
            while job.process.exitcode is None and time.monotonic() - since < LEAVING:
                job.printed.drain()  # it may have more to print than its pipe holds
                job.wait(TICK)
            job.kill()
            job.printed.close()


def _beyond(job: Worker, timeout: float | None, now: float) -> float | None:
    """The limit that the worker has passed, in seconds; None: it has not."""
    limit = None if timeout is None else timeout if job.what == "run" else timeout + PREPARE
    return limit if limit is not None and now - job.since > limit else None
