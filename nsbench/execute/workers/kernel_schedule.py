"""Which specs a worker takes next: on a new machine no worker waits for kernels that another one
compiles.

Runs of one solver on one kind of problem share kernels; which families of constraints a case has
decides which of them it needs. A worker that comes to families it has not met with this solver
holds the solver's lock during the first run;
the others take what they can meanwhile, come back, and load from the cache on disk what was
compiled (that no kernel is compiled twice, nsbench.compilation.compile_lock sees to). The lock is a
file's: it goes with the process that holds it, whatever becomes of that.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

from nsbench.case import parse_spec
from nsbench.compilation.disk_cache import digest
from nsbench.study import Spec
from nsbench.study.plan import resolve

PAUSE = 0.05  # seconds between two looks at locks that are all taken


class KernelSchedule:
    """The order of specs in one process; folder: where the locks of all processes lie."""

    def __init__(self, folder: str):
        self.folder = Path(folder)
        self.known = set()

    def order(self, specs: list[Spec]) -> Iterator[tuple[int, Spec]]:
        """Every (index, spec) once; those that share kernels follow one another."""
        groups: dict[str, list] = {}
        for i, spec in enumerate(specs):
            groups.setdefault(kernels_of(spec), []).append((i, spec))
        while groups:
            key, lock = self._next(groups)
            first, *rest = groups.pop(key)
            try:
                yield first
            finally:
                if lock is not None:
                    lock.release()
            self.known.add(key)
            yield from rest

    def _next(self, groups):
        """A group whose solver nobody else is compiling for, with the lock that is held (None: its
        kernels are known here)."""
        while True:
            for key in groups:
                lock = None if key in self.known else self._lock(" ".join(key.split()[:2]))
                if key in self.known or lock is not None:
                    return key, lock
            time.sleep(PAUSE)

    def _lock(self, key: str):
        from filelock import FileLock, Timeout

        lock = FileLock(self.folder / digest(key)[:16])
        try:
            return lock.acquire(timeout=0).lock
        except Timeout:
            return None


def kernels_of(spec: Spec) -> str:
    """Runs with the same words need the same kernels, as far as can be told before they are
    prepared: solver, kind of problem, families of constraints. Where the first two are the same,
    most kernels are."""
    try:
        problem = resolve(spec.case, spec.file).problem
    except Exception:  # it is the run's row that tells why
        return spec.label
    families = {
        f"{type(c).__name__}{'*' * bool(getattr(c, 'all_pairs', False))}"
        for c in getattr(problem, "constraints", ())
    }
    return " ".join([parse_spec(spec.solver)[0], type(problem).__name__, *sorted(families)])
