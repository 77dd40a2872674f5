"""Rows computed by the workers of an existing Dask cluster, as `nsbench.execute.workers.pool`
computes them here.

Runs are sent as data (specifications; case and solver files, with modules and data beside them),
never as code, to workers that have the same package. What a run is made of is looked at again where
it is made (nsbench.execute.cluster.same_sources).
A task is a list of runs of which a worker does what it can within a slice of time; what is left
goes back to the queue, so that rows come soon, however long runs are, and no task holds more than
MOST rows. Only a few tasks per thread are under way, each is forgotten as soon as its rows were
handed on, and specifications are taken from their iterator as they are needed: the client's memory
does not grow with their number.

A worker that dies is the scheduler's to replace: it sends its tasks elsewhere (as often as the
cluster's setting distributed.scheduler.allowed-failures says). A task that lost too many workers is
taken apart, and its runs are tried once more, alone on the cluster, one after the other: the run
that loses its workers again is the one to blame, and becomes a "crashed" row.
"""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import os
import secrets
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import chain, islice
from pathlib import Path

from nsbench.execute.cluster.remote_worker import (
    LARGE,
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

CONNECT = 4.0  # seconds to answer in
# seconds without a single worker after which a cluster is given up (a nanny restarts in a few)
WORKERLESS = 60.0
HEAR = 0.5  # seconds until a signal is heard
LOOK = 2.0  # seconds between two looks at how many workers there are
AHEAD = 2  # tasks per thread: one at work, one waiting for it to end
MOST = 500  # runs per task: their rows are a few MB
EXTRA = "--dask needs the package distributed: pip install 'nsbench[dask]'"


class ClusterError(Exception):
    """The cluster cannot be used, or not any more; the message says why."""


def run_all(
    batches: Iterable[Iterable[Spec]],
    address: str,
    timeout: float | None,
    on_row: Callable[[Spec, dict], None],
    most: int | None = None,
    on_output: Callable[[Spec, bytes], None] = lambda spec, text: None,
    parts: Mapping[Spec, tuple[run_key.Part, ...]] | None = None,
) -> list:
    """Rows of all batches, handed to on_row(spec, row) as they come, marked as `shared`: seconds on
    workers that do who knows what else are no measurement. most: bytes that a run may hold (None:
    its processor's share of the worker's machine); on_output is told what a run has printed, if
    anything, before on_row; parts: what the runs are made of here: a worker that finds anything
    else in its place is refused. Returns [], the chores done; the cluster is left as it was. A
    signal that stops the program takes effect between two rows.

    Raises ClusterError (no answer, no workers, workers that are not like this installation),
    ValueError (no such address, distributed is not installed). KeyboardInterrupt stops the runs
    under way and passes on.
    """
    with connected(address) as client, signals.defer_signals():
        here = fingerprint()
        _check(client, address, here)
        work = _Work(client, address, timeout, chain.from_iterable(batches), here, most, parts)
        try:
            for spec, row, text in work.rows():
                if text:
                    on_output(spec, text)
                on_row(spec, row | {"shared": True})
                signals.check()
        finally:
            work.end()
    return []


def connected(address: str):
    """A client of the scheduler at `address`, to be closed."""
    try:
        from distributed import Client
        from distributed.core import connect
    except ImportError:
        raise ValueError(EXTRA) from None

    async def knock():
        await (await connect(address, timeout=CONNECT)).close()

    try:
        asyncio.run(knock())  # a client that found nobody would say so for a long time
    except ValueError as e:
        raise ValueError(
            f"--dask {address!r} is no address such as tcp://10.0.0.1:8786: {_first_line(e)}"
        ) from None
    except Exception as e:  # refused, no such host, too late, or not how a scheduler answers
        raise ClusterError(f"no scheduler answers at {address}: {_first_line(e)}") from None
    return Client(address, timeout=CONNECT, set_as_default=False, name="nsbench")


def _check(client, address: str, here: dict[str, str]) -> None:
    """Are there workers, and would they compute the same numbers?"""
    until = time.monotonic() + WORKERLESS
    while not client.nthreads():
        if time.monotonic() > until:
            raise ClusterError(f"the cluster at {address} has had no workers for {WORKERLESS:g} s")
        time.sleep(0.1)
    for worker, there in client.run(fingerprint, on_error="return").items():
        if isinstance(there, BaseException):
            raise ClusterError(
                f"the worker {worker} cannot load nsbench: {_first_line(there)}; install the same "
                f"version there"
            )
        differs = installation_mismatch(there, here)
        if differs:
            raise ClusterError(_refusal(worker, differs))


def _refusal(worker: str, differs: str) -> str:
    return (
        f"the worker {worker} is not like this installation: {differs}; its numbers might be "
        f"others: install the same there"
    )


def _first_line(error: BaseException) -> str:
    return (str(error).strip() or type(error).__name__).splitlines()[0][:300]


class _Work:
    """The runs that are still to do, and the tasks under way."""

    def __init__(
        self,
        client,
        address: str,
        timeout: float | None,
        specs: Iterator[Spec],
        here: dict[str, str],
        most: int | None = None,
        parts: Mapping | None = None,
    ):
        self.parts = parts or {}
        self.client = client
        self.address = address
        self.timeout = timeout
        self.here = here
        self.most = most
        self.owner = secrets.token_hex(6)
        self.units = {}
        self.specs, self.rest = (
            specs,
            deque(),
        )  # not taken yet; given back by tasks that ran out of time
        self.suspects = deque()  # runs of tasks that lost their workers
        self.flying: dict = {}  # by future: its specs, and whether it is alone on the cluster
        self.size = 1
        self.sent = 0
        self.room = 0
        self.looked = self.peopled = -1e9

    def rows(self) -> Iterator[tuple[Spec, dict, bytes]]:
        """(spec, row, what it printed) of every run, as the rows come."""
        from distributed import wait

        while True:
            self._look()
            while len(self.flying) < self.room and (task := self._take()):
                self._send(*task)
            if not self.flying and self.room:
                return
            with self._scheduler():
                done = ()
                with contextlib.suppress(TimeoutError), self.client.as_current():
                    done = wait(list(self.flying), timeout=HEAR, return_when="FIRST_COMPLETED").done
            signals.check()
            for future in done:
                yield from self._received(future, *self.flying.pop(future))

    def _take(self) -> tuple[list[Spec], bool] | None:
        """Runs for the next task and whether they are suspects; None: nothing to send now."""
        if self.rest:
            specs = self.rest.popleft()
            if specs[self.size :]:
                self.rest.appendleft(specs[self.size :])
            return specs[: self.size], False
        if fresh := list(islice(self.specs, self.size)):
            return fresh, False
        return ([self.suspects.popleft()], True) if self.suspects and not self.flying else None

    def _send(self, specs: list[Spec], alone: bool) -> None:
        owners = dict.fromkeys(
            names for s in specs for names in ((s.file,), s.solver_files) if any(names)
        )
        units = [self._unit(names) for names in owners]
        asked = [self._asked(s) for s in specs]
        self.sent += 1
        future = self.client.submit(
            rows_of,
            asked,
            self.timeout,
            self.most,
            self.owner,
            self.here,
            units,
            key=f"nsbench-{self.owner}-{self.sent}",
            pure=False,
        )
        self.flying[future] = specs, alone

    def _asked(self, spec: Spec) -> Spec:
        return dataclasses.replace(spec, parts=tuple(p.digest for p in self.parts.get(spec, ())))

    def _unit(self, names: tuple[str, ...]) -> dict[str, bytes | str]:
        """Files of one case or of all solvers and all they need beside the package: contents, or
        digests of large ones."""
        if names not in self.units:
            files = {os.path.realpath(n): n for n in names} | {
                f: f for f in run_key.user_files(*names) if f not in map(os.path.realpath, names)
            }
            self.units[names] = {
                f: file_state.digest(f) if os.path.getsize(f) > LARGE else Path(f).read_bytes()
                for f in files.values()
            }
        return self.units[names]

    def _received(
        self, future, specs: list[Spec], alone: bool
    ) -> Iterator[tuple[Spec, dict, bytes]]:
        from distributed import KilledWorker

        with self._scheduler():
            error = future.exception()
            rows = []
            try:
                rows = rows if error else future.result()
            except (
                KilledWorker
            ) as e:  # the worker died that kept the rows, and then those that made them anew
                error = e
            future.release()
        if isinstance(error, OtherInstallation):  # a worker that joined later
            raise ClusterError(_refusal("that joined", str(error)))
        if error is None:
            self._measured(len(rows), specs)
        elif not alone:
            self.suspects += specs
        elif isinstance(error, KilledWorker):
            why = f"The cluster lost every worker that was given this run: {_first_line(error)}"
            rows = [(lost_run_row(specs[0], "crashed", why), b"")]
        else:
            why = f"The worker could not begin: {type(error).__name__}: {_first_line(error)}"
            rows = [(lost_run_row(specs[0], "crashed", why), b"")]
        for spec, (row, text) in zip(specs, rows, strict=False):
            if there := row.pop("unlike", None):
                own = {k: v for p in self.parts[spec] for k, v in p.items}
                raise ClusterError(
                    f"a worker would make {spec.label} of something else: "
                    f"{there.get('why') or installation_mismatch(there, own)}; "
                    "what is there must be as here"
                )
            yield spec, row, text

    def _measured(self, done: int, specs: list[Spec]) -> None:
        """`done` of the specs of a task have their rows: the others once more, and tasks of a size
        that fits the slice."""
        if done < len(specs):
            self.rest.append(specs[done:])
            self.size = done
        elif done == self.size:
            self.size = min(2 * done, MOST)

    def _look(self) -> None:
        """How many tasks may be under way, by the threads there are now."""
        now = time.monotonic()
        if now - self.looked < LOOK:
            return
        with self._scheduler():
            threads = sum(self.client.nthreads().values())
        self.looked = now
        self.room = AHEAD * threads
        self.peopled = now if threads or self.peopled < 0 else self.peopled
        if now - self.peopled > WORKERLESS:
            raise ClusterError(
                f"the cluster at {self.address} has had no workers for {WORKERLESS:g} s"
            )

    @contextlib.contextmanager
    def _scheduler(self):
        """What is raised when the scheduler has gone is told as that."""
        from concurrent.futures import CancelledError

        try:
            yield
        except (CancelledError, OSError) as e:
            raise ClusterError(
                f"the scheduler at {self.address} is gone: {_first_line(e)}"
            ) from None

    def end(self) -> None:
        """Take back what is under way and send the processes home."""
        with contextlib.suppress(Exception):  # whatever it says: the client is closed next
            self.client.cancel(list(self.flying), force=True)
            self.client.run(dismiss, self.owner, on_error="ignore")
