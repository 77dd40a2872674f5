"""Estimate of the time that a study still takes, from the rows of the runs that have ended.

The first run of a group of kernels (nsbench.execute.workers.kernel_schedule) compiles them, which
on a new machine takes more time than all runs; such costs are kept apart:

    left = (sum of work * rate of the solver + mean first compilation * groups not met yet
            + mean later compilation * runs) / workers

Work is what nsbench.execute.forecast foresees of a run, in steps of one coordinate, plus
FIXED_WORK; the rate of a solver is the median of seconds per work, and for a solver without a row
yet the median over the solvers. Replayed on the standard suite with nothing compiled (3923 runs,
5 min) the estimate is within a factor 2 of the truth from the fifth run on.
"""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from nsbench.execute.forecast import COLD_COMPILATION, MEASURE, seconds_with_repetitions, work
from nsbench.execute.workers.kernel_schedule import kernel_group
from nsbench.study import Spec

FIXED_WORK = 5e4  # per run, in steps of one coordinate: preparation, measuring, repetitions
FIRST_PRIOR = 3.0  # groups: weight of FIRST_COMPILATION beside what was observed
FIRST_COMPILATION = 1.5  # seconds: the mean over groups where kernels are on the disk
LOADED = 2.0  # seconds: a first run that compiled for less has loaded what was stored
LATER_PRIOR = 100.0  # runs without a compilation, beside those observed
EMPTY_STUDY = 1e-3  # seconds that count as no time at all


class RemainingTime:
    """Costs of the runs that have ended, and what is still to do.

    specs: all runs of the study; jobs: workers (None: as many as the costs so far, divided by the
    time spent, say).
    """

    def __init__(self, specs: list[Spec], jobs: int | None):
        self.jobs = jobs
        self.work: dict[str, float] = defaultdict(float)  # to do, by solver
        self.groups: dict[str, int] = defaultdict(int)  # runs to do, by kernel group
        self.rates: dict[str, list[float]] = defaultdict(list)
        self.met: set[str] = set()  # kernel groups of which a run has ended
        self.first_compilations: list[float] = []
        self.later_compilations: list[float] = []
        self.spent = 0.0  # seconds of workers
        for spec in specs:
            self.work[spec.solver] += _work(spec)
            self.groups[kernel_group(spec)] += 1

    def add(self, spec: Spec, row: dict) -> None:
        """Record a run that has ended, by its first row."""
        group = kernel_group(spec)
        weight = _work(spec)
        self.work[spec.solver] -= weight
        self.groups[group] -= 1
        compilation = _seconds(row, "compile_seconds")
        cost = seconds_with_repetitions(_seconds(row, "seconds"), _seconds(row, "setup_seconds"))
        self.spent += compilation + cost
        if weight > 0.0:
            self.rates[spec.solver].append((cost + MEASURE) / weight)
        first = group not in self.met
        (self.first_compilations if first else self.later_compilations).append(compilation)
        self.met.add(group)

    def compilation(self) -> float:
        """Estimate the seconds in which a group that is not on the disk is compiled."""
        compiled = [s for s in self.first_compilations if s > LOADED]
        return (sum(compiled) + COLD_COMPILATION) / (len(compiled) + 1)

    def seconds(self, elapsed: float) -> float:
        """Estimate the seconds left on the clock; elapsed: those spent."""
        rates = {solver: float(np.median(several)) for solver, several in self.rates.items()}
        unknown = float(np.median(list(rates.values()))) if rates else 0.0
        left = sum(work * rates.get(solver, unknown) for solver, work in self.work.items())
        first = sum(self.first_compilations) + FIRST_PRIOR * FIRST_COMPILATION
        unmet = sum(1 for group, runs in self.groups.items() if runs and group not in self.met)
        left += unmet * first / (len(self.first_compilations) + FIRST_PRIOR)
        later = sum(self.later_compilations) / (len(self.later_compilations) + LATER_PRIOR)
        left += later * sum(self.groups.values())
        workers = self.jobs or max(1.0, self.spent / max(elapsed, EMPTY_STUDY))
        return max(0.0, left) / workers


def _work(spec: Spec) -> float:
    foreseen = work(spec)
    return foreseen + FIXED_WORK if foreseen else 0.0  # a refusal takes no time


def _seconds(row: dict, column: str) -> float:
    value = row.get(column, 0.0)
    return value if isinstance(value, float) and np.isfinite(value) else 0.0
