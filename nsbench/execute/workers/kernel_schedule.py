"""Order of the runs of one worker, so that workers do not wait for kernels that another compiles.

Runs of one solver on one kind of problem share kernels; which families of constraints a case has
decides which of them it needs. A worker that comes to families for which it has not yet run this
solver holds the solver's lock during the first such run; the others take what they can meanwhile,
come back, and load from the cache on disk what was compiled (nsbench.compilation.compile_lock keeps
two processes from compiling one kernel). The lock is on a file: it is released when the process
that holds it ends, however it ends.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

from nsbench.case import parse_spec
from nsbench.compilation.disk_cache import digest
from nsbench.study import Spec
from nsbench.study.plan import resolve

SECONDS_BETWEEN_TRIES = 0.05  # where the locks of all groups are taken


class KernelSchedule:
    """Order of specs in one process; folder: where the lock files of all workers are."""

    def __init__(self, folder: str):
        self.folder = Path(folder)
        self.loaded: set[str] = set()  # kernel groups that this process has run

    def order(self, specs: list[Spec]) -> Iterator[tuple[int, Spec]]:
        """Yield every (index, spec) once; those that share kernels follow one another."""
        groups: dict[str, list] = {}
        for i, spec in enumerate(specs):
            groups.setdefault(kernel_group(spec), []).append((i, spec))
        while groups:
            group, lock = self._next_group(groups)
            first, *rest = groups.pop(group)
            try:
                yield first
            finally:
                if lock is not None:
                    lock.release()
            self.loaded.add(group)
            yield from rest

    def _next_group(self, groups):
        """A group whose solver no other process compiles for, with the lock that is held.

        The lock is None for a group whose kernels this process has.
        """
        while True:
            for group in groups:
                if group in self.loaded:
                    return group, None
                solver_and_problem = " ".join(group.split()[:2])
                lock = self._try_lock(solver_and_problem)
                if lock is not None:
                    return group, lock
            time.sleep(SECONDS_BETWEEN_TRIES)

    def _try_lock(self, name: str):
        """The lock of this name, or None if another process holds it."""
        from filelock import FileLock, Timeout

        lock = FileLock(self.folder / digest(name)[:16])
        try:
            return lock.acquire(timeout=0).lock
        except Timeout:
            return None


def kernel_group(spec: Spec) -> str:
    """Name the kernels that a run needs: solver, kind of problem, families of constraints.

    Runs with the same name need the same kernels, as far as that can be known before they are
    prepared; where the first two words are the same, most kernels are.
    """
    try:
        problem = resolve(spec.case, spec.file, spec.references).problem
    except Exception:  # the row of the run will give the reason
        return spec.label
    families = {
        f"{type(c).__name__}{'*' * bool(getattr(c, 'all_pairs', False))}"
        for c in getattr(problem, "constraints", ())
    }
    return " ".join([parse_spec(spec.solver)[0], type(problem).__name__, *sorted(families)])
