"""Run of a fixed-step method to a tolerance: steps are chosen by the error bars of the run before.

A pass with long steps has error bars that are made of what each sample interval adds and of the
distance to the feasible set, both proportional to the step. The next pass has steps that would keep
the tolerance, longer where little is added: for a sum of a_k h_k at least work, h_k ~ a_k^(-1/2).
Half of that power is taken, since what an interval adds depends on the steps before it. Estimates
need less of an allowance from the second pass on: the run before confirms them (Bars.confirmed).
A pass that is not sound, since its steps are too long for the scene, has no error bars to go by:
steps are divided by SHORTENED until one is.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from nsbench.case import Case
from nsbench.error_bars import Bars, ErrorBars, error_bars, without_error_bars
from nsbench.solvers.base import Claims, Solver
from nsbench.solvers.common.time_grid import substeps
from nsbench.solvers.scaled_run import ScaledRun
from nsbench.trajectory import Status, Trajectory

FIRST_STEPS = 16  # of the first pass, at least
PASSES = 12
SAFETY = 0.9  # of the tolerance, which a pass is to reach
# a pass whose steps are more than FAR times too long foretells those of the last one badly: one
# between them, with steps BETWEEN times too long, costs little beside it
FAR = 8.0
BETWEEN = 4.0
LEAST = 1.0 / 64.0  # a pass shortens steps by no more: what it knows of shorter ones is little
POWERS = (0.0, 0.25)  # of what is gained, with which steps are shorter
LONGER = np.linspace(1.5, 1.0, 11)  # times what is needed, which a whole number of steps may allow
EVEN = 1.4  # steps differ from equally long ones by at most this factor in one pass
MOST_STEPS = 20_000_000
# how runs end whose steps are too long: less than that is known of how long they may be
TOO_LONG = ("diverged", "degenerate", "unverified")
SHORTENED = 4.0
SOUGHT_STEPS = 1_000_000  # of the last pass that may end so


class StepOrTolerance:
    """Method of order one with fixed steps, or with steps for a tolerance: its option `tol`.

    Without `tol` the accuracy is the step h. With it the accuracy is a tolerance of the state in
    the units of the user, and steps are chosen along the run so that the error bars stay below it.
    """

    tol: float | None
    has_error_bars = True

    @property
    def accuracy(self) -> str:
        """Name of the accuracy parameter: steps, or with `tol` a tolerance."""
        return "h" if self.tol is None else "tol"

    @property
    def default(self) -> float:
        """Accuracy that is taken where none is asked for."""
        return 1e-2 if self.tol is None else self.tol

    @property
    def ladder(self) -> tuple[float, ...]:
        """Tolerance of a study where none is asked for: that of the name."""
        return (self.default,)

    @property
    def claims(self) -> Claims:
        """Order one in the step; none in the tolerance, which is a bound or an estimate."""
        return Claims(state=1.0, impulse=1.0) if self.tol is None else Claims()

    def refuses_tolerance(self, case: Case) -> str | None:
        """Return why no error bars, and so no steps for a tolerance, exist for a case."""
        if self.tol is not None and (why := without_error_bars(case)):
            return f"A step cannot be chosen by error bars. {why}"
        return None

    def prepare_tolerance(self, case: Case, tolerance: float) -> ToleranceRun:
        """Prepare passes with steps that are chosen for a tolerance."""
        return ToleranceRun(dataclasses.replace(self, tol=None), case, tolerance)


class ToleranceRun:
    """Prepared run of a fixed-step method whose error bars are to stay below `tolerance`.

    The tolerance is one of the state, in the 2-norm and in the units of the case. The counted work
    is that of all passes.
    """

    def __init__(self, method: Solver, case: Case, tolerance: float):
        self.method = method
        self.case = case
        self.tolerance = tolerance
        spacing = np.diff(case.t)
        self.first = whole_steps(spacing, (case.t[-1] - case.t[0]) / FIRST_STEPS)
        # by pass: they come out the same in every call
        self.prepared = [ScaledRun(method, case, self.first)]

    def __call__(self) -> Trajectory:
        """Run passes until the error bars keep the tolerance."""
        h = self.first
        done: list[Trajectory] = []
        before: Bars | None = None
        for k in range(PASSES):
            if k == len(self.prepared):
                self.prepared.append(ScaledRun(self.method, self.case, h))
            run = self.prepared[k]
            traj = run.to_user_units(run())
            done.append(traj)
            made = error_bars(self.case, traj).made
            bars = made.confirmed(traj.x, before, done[-2].x) if before else made
            error = float(np.max(bars.state))
            if self._has_too_long_steps(traj, h):
                h = whole_steps(np.diff(self.case.t), h / SHORTENED)
                before = None
                continue
            if not traj.status.ok or not np.isfinite(error):
                return self._ended(done, bars, _failed(traj, bars))
            if error <= self.tolerance:
                return self._ended(done, bars, traj.status)
            # the next pass is confirmed by this one
            expected = bars if before else made.allowed(0.0)
            h = next_steps(h, np.diff(self.case.t), expected, self.tolerance)
            before = made
            if float((np.diff(self.case.t) / h).sum()) > MOST_STEPS:
                break
        why = f"The tolerance {self.tolerance:.3g} was not reached: the error bar is {error:.3g}."
        return self._ended(done, bars, Status("unverified", why))

    def _has_too_long_steps(self, traj: Trajectory, h: np.ndarray) -> bool:
        """Did a pass end as one with too long steps does, and may shorter ones be tried?"""
        next_count = SHORTENED * float((np.diff(self.case.t) / h).sum())
        return traj.status.code in TOO_LONG and next_count <= SOUGHT_STEPS

    def _ended(self, done: list[Trajectory], bars: Bars, status: Status) -> Trajectory:
        last = done[-1]
        stats = dict(last.stats)
        for name in ("steps", "drift_calls", "projections", "qp_solves", "inner_iterations"):
            if name in stats:
                stats[name] = sum(traj.stats[name] for traj in done)
        stats["passes"] = len(done)
        return dataclasses.replace(
            last, status=status, stats=stats, bound=ErrorBars(lambda: bars), resolution=None
        )


def _failed(traj: Trajectory, bars: Bars) -> Status:
    """Return the status of a pass that failed, or has no error bars."""
    if not traj.status.ok:
        return traj.status
    return Status("unverified", f"No step can be chosen. {bars.why}")


def next_steps(h: np.ndarray, spacing: np.ndarray, bars: Bars, tolerance: float) -> np.ndarray:
    """Return steps (k - 1,) that would keep the tolerance, from the error bars with the steps h.

    Of steps as they are, longer ones where little is gained, and equal ones, those are taken that
    need the least work. A sample interval has a whole number of them.
    """
    density = np.maximum(bars.gained / spacing, 1e-300)
    mean = np.exp(np.log(density).mean())
    ratios = [np.clip((mean / density) ** p, 1.0 / EVEN, EVEN) for p in POWERS]
    ratios.append(np.exp(np.log(h).mean()) / h)
    found = []
    for ratio in ratios:
        aim = SAFETY * tolerance
        needed = aim / max(_predicted(bars, ratio), 1e-300)
        if needed < 1.0 / FAR:
            aim *= BETWEEN
            needed *= BETWEEN
        needed = np.clip(needed, LEAST, 0.9)
        tried = [whole_steps(spacing, h * ratio * needed * more) for more in LONGER]
        steps = next((s for s in tried if _predicted(bars, s / h) <= aim), tried[-1])
        found.append((float((spacing / steps).sum()), steps))
    return min(found, key=lambda pair: pair[0])[1]


def whole_steps(spacing: np.ndarray, h: np.ndarray) -> np.ndarray:
    """Return the steps (k - 1,) that are taken where steps h are asked for."""
    return spacing / substeps(spacing, h)


def _predicted(bars: Bars, ratio: np.ndarray) -> float:
    """Return the largest error bar of the state if steps change by `ratio` (k - 1,).

    At a sample, the part that is no more than the distance to the feasible set changes with the
    step there; the rest as the sum of what was gained before it.
    """
    gained = np.append(0.0, np.cumsum(bars.gained))
    changed = np.append(0.0, np.cumsum(bars.gained * ratio))
    around = np.append(ratio[0], ratio)
    mean = np.where(gained > 0.0, changed / np.maximum(gained, 1e-300), around)
    carried = np.maximum(bars.state - bars.distance, 0.0)
    return float(np.max(carried * mean + (bars.state - carried) * around))
