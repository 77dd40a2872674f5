"""Chores whose values count, on local workers that stay warm from one call to the next."""

from __future__ import annotations

import contextlib
import functools
import tempfile
from collections.abc import Callable, Iterator, Sequence

from nsbench.execute.workers import memory, signals
from nsbench.execute.workers.pool import WorkerPool
from nsbench.execute.workers.worker import Chore


@contextlib.contextmanager
def chore_workers(jobs: int, memory_limit: int | None = None) -> Iterator[Callable]:
    """Yield a function (tasks, on_value) that computes tasks on `jobs` workers.

    A task is a function with its arguments; on_value is called with the number of a task and its
    value as soon as that is there. What a task raises is raised; LostChore where its worker ends,
    also because it holds more than memory_limit bytes (None: its share of the machine). A signal
    that stops the program takes effect between two values. No worker is left in the end.
    """
    with tempfile.TemporaryDirectory(prefix="nsbench-", ignore_cleanup_errors=True) as locks:
        pool = WorkerPool(
            queue=[],
            timeout=None,
            on_row=None,
            on_output=None,
            threads=1,
            memory_limit=memory_limit or memory.worker_limit(jobs),
            locks=locks,
            keep_idle=True,
        )
        try:
            yield functools.partial(_compute, pool, jobs)
        finally:
            pool.stop()


def _compute(
    pool: WorkerPool,
    jobs: int,
    tasks: Sequence[tuple[Callable, tuple]],
    on_value: Callable[[int, object], None],
) -> None:
    chores = [Chore(*task) for task in tasks]
    numbers = {id(chore): number for number, chore in enumerate(chores)}

    def on_chore(chore: Chore, value: object, error: Exception | None) -> None:
        if error is not None:
            raise error
        on_value(numbers[id(chore)], value)

    pool.on_chore = on_chore
    pool.queue += reversed(chores)
    with signals.defer_signals():
        while pool.queue or pool.busy:
            pool.start_workers(jobs)
            pool.receive()
            pool.enforce_limits()
        signals.check()
