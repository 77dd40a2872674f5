"""Chores whose values count, on the workers of a Dask cluster.

As nsbench.execute.workers.chores: a thread of the cluster has a supervised process that computes,
of the same installation as here; what ends with its client ends such a process.
"""

from __future__ import annotations

import contextlib
import functools
import secrets
from collections.abc import Callable, Iterator, Sequence

from nsbench.execute.cluster.client import (
    SECONDS_BETWEEN_SIGNAL_CHECKS,
    ClusterError,
    check_workers,
    connect_client,
    describe_mismatch,
    first_line,
    scheduler_errors,
)
from nsbench.execute.cluster.remote_worker import (
    Limits,
    OtherInstallation,
    dismiss,
    fingerprint,
    process_for,
)
from nsbench.execute.workers import signals
from nsbench.execute.workers.worker import Chore, LostChore


@contextlib.contextmanager
def cluster_workers(address: str, memory_limit: int | None = None) -> Iterator[Callable]:
    """Yield a function (tasks, on_value) that computes tasks on the cluster at `address`.

    As nsbench.execute.workers.chores.chore_workers; raises ClusterError too, and ValueError for an
    address that is none.
    """
    with connect_client(address) as client:
        here = fingerprint()
        check_workers(client, address, here)
        owner = secrets.token_hex(6)
        request = Limits(None, memory_limit), owner, here
        try:
            yield functools.partial(_compute, client, address, request)
        finally:
            with contextlib.suppress(Exception):  # whatever it says: the client is closed next
                client.run(dismiss, owner, on_error="ignore")


def _compute(
    client,
    address: str,
    request: tuple[Limits, str, dict[str, str]],
    tasks: Sequence[tuple[Callable, tuple]],
    on_value: Callable[[int, object], None],
) -> None:
    from distributed import wait

    numbers = {
        client.submit(outcome_of, Chore(*task), *request, pure=False): number
        for number, task in enumerate(tasks)
    }
    try:
        while numbers:
            done = ()
            with scheduler_errors(address):
                with contextlib.suppress(TimeoutError), client.as_current():
                    done = wait(
                        list(numbers),
                        timeout=SECONDS_BETWEEN_SIGNAL_CHECKS,
                        return_when="FIRST_COMPLETED",
                    ).done
                outcomes = [(f, f.exception() or f.result()) for f in done]
                deserted = not done and not client.nthreads()
            if deserted:
                check_workers(client, address, request[-1])
            for future, outcome in outcomes:
                value = _value_of(outcome)
                with signals.defer_signals():
                    on_value(numbers.pop(future), value)
                    signals.check()
    finally:
        with contextlib.suppress(Exception):
            client.cancel(list(numbers), force=True)


def _value_of(outcome: tuple[object, Exception | None] | BaseException) -> object:
    """Return the value of a task; raise what it raised, ClusterError where the cluster failed."""
    if isinstance(outcome, OtherInstallation):  # a worker that joined later
        raise ClusterError(describe_mismatch("that joined", str(outcome)))
    if isinstance(outcome, BaseException):
        raise ClusterError(f"the cluster lost a part: {first_line(outcome)}")
    value, error = outcome
    if error is not None:
        raise error
    return value


def outcome_of(
    chore: Chore, limits: Limits, owner: str, expected: dict[str, str]
) -> tuple[object, Exception | None]:
    """Do a chore in the process of this thread; return its value and None, or what it raised.

    owner: names the study; expected: the client's fingerprint. Raises OtherInstallation.
    """
    outcomes: list[tuple[object, Exception | None]] = []
    with process_for(owner, expected) as process:
        if process is not None:
            process.pool.on_chore = lambda chore, *outcome: outcomes.append(outcome)
            process.work(chore, limits)
    return outcomes[0] if outcomes else (None, LostChore("the study was stopped"))
