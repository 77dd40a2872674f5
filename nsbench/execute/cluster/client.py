"""Client of a Dask cluster: its workers compute rows, as those of execute.workers.pool do here.

Runs are sent as data (specifications; case and solver files, with the modules and data that they
use), never as code, to workers that have the same package. What a run is made of is checked again
where it is made (nsbench.execute.cluster.same_sources).
A task is a list of runs of which a worker does what it can within a slice of time; the others go
back to the queue, so that rows come soon, however long runs are, and no task has more than
MAX_TASK_SIZE rows. Only a few tasks per thread are in flight, each is released as soon as its rows
were handed on, and specifications are taken from their iterator as they are needed: the client's
memory does not grow with their number.

A worker that dies is replaced by the scheduler, which sends its tasks elsewhere (as often as the
cluster's setting distributed.scheduler.allowed-failures says). A task that lost too many workers is
taken apart, and its runs are tried once more, alone on the cluster, one after the other: the run
that loses its workers again is the one to blame, and becomes a "crashed" row.
"""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import math
import os
import secrets
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import chain, islice
from pathlib import Path

from nsbench.execute.cluster.remote_worker import (
    MAX_FILE_SIZE,
    Limits,
    OtherInstallation,
    dismiss,
    fingerprint,
    installation_mismatch,
    rows_of,
)
from nsbench.execute.workers import signals
from nsbench.results import run_key
from nsbench.source_files import file_state
from nsbench.study import Spec
from nsbench.study.attempt import lost_run_row

CONNECTION_TIMEOUT = 4.0  # seconds
# seconds without a single worker after which a cluster is given up (a nanny restarts in a few)
WORKERLESS_TIMEOUT = 60.0
SECONDS_BETWEEN_SIGNAL_CHECKS = 0.5
SECONDS_BETWEEN_COUNTS = 2.0  # of the threads of the cluster
TASKS_PER_THREAD = 2  # one at work, one waiting for it to end
MAX_TASK_SIZE = 500  # runs: their rows are a few MB
MESSAGE_LENGTH = 300  # characters of an exception that are quoted
NEEDS_DISTRIBUTED = "--dask needs the package distributed: pip install 'nsbench[dask]'"


class ClusterError(Exception):
    """The cluster cannot be used, or not any more; the message says why."""


def run_all(
    batches: Iterable[Iterable[Spec]],
    address: str,
    timeout: float | None,
    on_row: Callable[[Spec, dict], None],
    memory_limit: int | None = None,
    on_output: Callable[[Spec, bytes], None] = lambda spec, text: None,
    parts: Mapping[Spec, tuple[run_key.Part, ...]] | None = None,
) -> list:
    """Run all batches on the workers of a cluster; rows go to on_row(spec, row) as they come.

    Rows are marked as `shared`: seconds on workers that do other work as well are no measurement.
    timeout: seconds of one run (None: no limit); memory_limit: bytes that a run may use (None: its
    processor's share of the worker's machine); on_output is called with what a run has printed, if
    anything, before on_row; parts: what the runs are made of here: a worker that finds anything
    else is refused. Returns [], as no chores are done; the cluster is left as it was. A signal that
    stops the program takes effect between two rows.

    Raises ClusterError (no answer, no workers, workers that are not like this installation),
    ValueError (no such address, distributed is not installed). KeyboardInterrupt stops the runs
    in flight and passes on.
    """
    with connect_client(address) as client, signals.defer_signals():
        here = fingerprint()
        check_workers(client, address, here)
        limits = Limits(timeout, memory_limit)
        work = _Work(client, address, chain.from_iterable(batches), here, limits, parts)
        try:
            for spec, row, text in work.rows():
                if text:
                    on_output(spec, text)
                on_row(spec, row | {"shared": True})
                signals.check()
        finally:
            work.stop()
    return []


def connect_client(address: str):
    """Connect a client to the scheduler at `address`; the caller closes it.

    Raises ValueError if distributed is not installed or the address is none, ClusterError if no
    scheduler answers.
    """
    try:
        from distributed import Client
        from distributed.core import connect
    except ImportError:
        raise ValueError(NEEDS_DISTRIBUTED) from None

    async def try_connection() -> None:
        await (await connect(address, timeout=CONNECTION_TIMEOUT)).close()

    try:
        asyncio.run(try_connection())  # a client without a scheduler would retry for a long time
    except ValueError as e:
        raise ValueError(
            f"--dask {address!r} is no address such as tcp://10.0.0.1:8786: {first_line(e)}"
        ) from None
    except Exception as e:  # refused, no such host, too late, or not how a scheduler answers
        raise ClusterError(f"no scheduler answers at {address}: {first_line(e)}") from None
    return Client(address, timeout=CONNECTION_TIMEOUT, set_as_default=False, name="nsbench")


def check_workers(client, address: str, here: dict[str, str]) -> None:
    """Raise ClusterError unless there are workers, all of them like this installation."""
    until = time.monotonic() + WORKERLESS_TIMEOUT
    while not client.nthreads():
        if time.monotonic() > until:
            raise ClusterError(
                f"the cluster at {address} has had no workers for {WORKERLESS_TIMEOUT:g} s"
            )
        time.sleep(0.1)
    for worker, there in client.run(fingerprint, on_error="return").items():
        if isinstance(there, BaseException):
            raise ClusterError(
                f"the worker {worker} cannot load nsbench: {first_line(there)}; install the same "
                f"version there"
            )
        differs = installation_mismatch(there, here)
        if differs:
            raise ClusterError(describe_mismatch(worker, differs))


def describe_mismatch(worker: str, differs: str) -> str:
    """Say that a worker is not like this installation."""
    return (
        f"the worker {worker} is not like this installation: {differs}; its numbers might be "
        f"others: install the same there"
    )


@contextlib.contextmanager
def scheduler_errors(address: str) -> Iterator[None]:
    """Within, errors that mean that the scheduler has gone become ClusterError."""
    from concurrent.futures import CancelledError

    try:
        yield
    except (CancelledError, OSError) as e:
        raise ClusterError(f"the scheduler at {address} is gone: {first_line(e)}") from None


def first_line(error: BaseException) -> str:
    """Return the first line of what an exception says, or the name of its type."""
    return (str(error).strip() or type(error).__name__).splitlines()[0][:MESSAGE_LENGTH]


@dataclasses.dataclass
class _Task:
    """Runs that were sent together; alone: nothing else is on the cluster."""

    specs: list[Spec]
    alone: bool


class _Work:
    """The runs that are still to do, and the tasks in flight."""

    def __init__(
        self,
        client,
        address: str,
        specs: Iterator[Spec],
        here: dict[str, str],
        limits: Limits,
        parts: Mapping | None = None,
    ):
        self.client = client
        self.address = address
        self.limits = limits
        self.here = here
        self.parts = parts or {}
        self.owner = secrets.token_hex(6)  # names this study on the workers
        self.units: dict[tuple[str, ...], dict[str, bytes | str]] = {}
        self.specs = specs  # not taken yet
        self.returned: deque[list[Spec]] = deque()  # by tasks that ran out of time
        self.suspects: deque[Spec] = deque()  # runs of tasks that lost their workers
        self.in_flight: dict = {}  # tasks by their future
        self.task_size = 1  # runs: about as many as end within the slice of a task
        self.sent = 0
        self.max_in_flight = 0
        self.counted_at = -math.inf
        self.workers_seen_at: float | None = None

    def rows(self) -> Iterator[tuple[Spec, dict, bytes]]:
        """Yield (spec, row, what it printed) of every run, as the rows come."""
        from distributed import wait

        while True:
            self._count_threads()
            while len(self.in_flight) < self.max_in_flight and (task := self._next_task()):
                self._send(task)
            if not self.in_flight and self.max_in_flight:
                return
            with scheduler_errors(self.address):
                done = ()
                with contextlib.suppress(TimeoutError), self.client.as_current():
                    done = wait(
                        list(self.in_flight),
                        timeout=SECONDS_BETWEEN_SIGNAL_CHECKS,
                        return_when="FIRST_COMPLETED",
                    ).done
            signals.check()
            for future in done:
                yield from self._receive(future, self.in_flight.pop(future))

    def _next_task(self) -> _Task | None:
        """Runs for the next task; None: nothing to send now."""
        if self.returned:
            specs = self.returned.popleft()
            if specs[self.task_size :]:
                self.returned.appendleft(specs[self.task_size :])
            return _Task(specs[: self.task_size], alone=False)
        if fresh := list(islice(self.specs, self.task_size)):
            return _Task(fresh, alone=False)
        if self.suspects and not self.in_flight:
            return _Task([self.suspects.popleft()], alone=True)
        return None

    def _send(self, task: _Task) -> None:
        groups = dict.fromkeys(
            names for s in task.specs for names in ((s.file,), s.solver_files) if any(names)
        )
        units = [self._files_of(names) for names in groups]
        requests = [self._with_parts(s) for s in task.specs]
        self.sent += 1
        future = self.client.submit(
            rows_of,
            requests,
            self.limits,
            self.owner,
            self.here,
            units,
            key=f"nsbench-{self.owner}-{self.sent}",
            pure=False,
        )
        self.in_flight[future] = task

    def _with_parts(self, spec: Spec) -> Spec:
        """The spec with the digests of what its run is made of here."""
        return dataclasses.replace(spec, parts=tuple(p.digest for p in self.parts.get(spec, ())))

    def _files_of(self, names: tuple[str, ...]) -> dict[str, bytes | str]:
        """Files of one case or of all solvers with all they need outside the package, by path.

        Values are contents, or digests of files that are too large to be sent.
        """
        if names not in self.units:
            files = {os.path.realpath(n): n for n in names} | {
                f: f for f in run_key.user_files(*names) if f not in map(os.path.realpath, names)
            }
            self.units[names] = {
                f: file_state.digest(f)
                if os.path.getsize(f) > MAX_FILE_SIZE
                else Path(f).read_bytes()
                for f in files.values()
            }
        return self.units[names]

    def _receive(self, future, task: _Task) -> Iterator[tuple[Spec, dict, bytes]]:
        """Yield the rows of a task that has ended; queue what it did not do."""
        from distributed import KilledWorker

        with scheduler_errors(self.address):
            error = future.exception()
            rows = []
            try:
                rows = rows if error else future.result()
            except KilledWorker as e:
                # the worker died that stored the rows, and then those that computed them again
                error = e
            future.release()
        if isinstance(error, OtherInstallation):  # a worker that joined later
            raise ClusterError(describe_mismatch("that joined", str(error)))
        if error is None:
            self._adapt_task_size(len(rows), task.specs)
        elif not task.alone:
            self.suspects += task.specs
        else:
            why = f"The worker could not begin: {type(error).__name__}: {first_line(error)}"
            if isinstance(error, KilledWorker):
                why = f"The cluster lost every worker that was given this run: {first_line(error)}"
            rows = [(lost_run_row(task.specs[0], "crashed", why), b"")]
        for spec, (row, text) in zip(task.specs, rows, strict=False):
            self._check_sources(spec, row.pop("unlike", None))
            yield spec, row, text

    def _check_sources(self, spec: Spec, there: dict[str, str] | None) -> None:
        """Raise ClusterError if a run was made of other items than those of here."""
        if not there:
            return
        here = {name: digest for part in self.parts[spec] for name, digest in part.items}
        raise ClusterError(
            f"a worker would make {spec.label} of something else: "
            f"{there.get('why') or installation_mismatch(there, here)}; "
            "what is there must be as here"
        )

    def _adapt_task_size(self, done: int, specs: list[Spec]) -> None:
        """Return the runs that a task did not do, and fit the size of tasks to their slice."""
        if done < len(specs):
            self.returned.append(specs[done:])
            self.task_size = done
        elif done == self.task_size:
            self.task_size = min(2 * done, MAX_TASK_SIZE)

    def _count_threads(self) -> None:
        """Set how many tasks may be in flight, by the threads that there are now.

        Raises ClusterError if there have been no workers for WORKERLESS_TIMEOUT.
        """
        now = time.monotonic()
        if now - self.counted_at < SECONDS_BETWEEN_COUNTS:
            return
        with scheduler_errors(self.address):
            threads = sum(self.client.nthreads().values())
        self.counted_at = now
        self.max_in_flight = TASKS_PER_THREAD * threads
        if threads or self.workers_seen_at is None:
            self.workers_seen_at = now
        if now - self.workers_seen_at > WORKERLESS_TIMEOUT:
            raise ClusterError(
                f"the cluster at {self.address} has had no workers for {WORKERLESS_TIMEOUT:g} s"
            )

    def stop(self) -> None:
        """Cancel what is in flight and end the processes that compute it."""
        with contextlib.suppress(Exception):  # whatever it says: the client is closed next
            self.client.cancel(list(self.in_flight), force=True)
            self.client.run(dismiss, self.owner, on_error="ignore")
