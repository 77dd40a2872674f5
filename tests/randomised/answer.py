"""The answer of a scene: event_driven at default settings, if another integrator at another
tolerance agrees with it.

CONDITION is how much more the samples move than a start that is moved by 1e-9 of the unit, which is
1, or the largest state or what the drift makes of the time if these are less (as in
tests/independent).
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from nsbench.diagnostics.rounding import largest_speed
from nsbench.problem import Complementarity
from randomised.ladder import EPS
from randomised.runs import Outcome, attempt, kept_feasible, relative

BOUND = 1e-9  # of the condition: what event_driven is held to, claims.exact being 1e-10
NUDGE = 1e-9  # of the unit: by which a start is moved for its condition, at least
ABSOLUTE = 1e-11  # what absolute tolerances leave in states that are small themselves
ROUNDINGS = 100.0  # spacings of the largest coordinate: of some 1500 steps, of random sign
WILD = 1e5  # a condition above which no answer can be judged: rounding alone moves it visibly
STEPS = "max_steps=1500"
FIRST = f"event_driven[{STEPS}]"
SECOND = tuple(
    (f"event_driven[{option},{STEPS}]", tol)
    for option, tol in (
        ("method=rk45", 1e-10),
        ("method=lsoda", 1e-11),
        ("method=radau", 1e-10),
        ("max_step=0.02", 1e-11),
    )
)


class Answer:
    """A case with its answer; `second` chooses how the answer is confirmed."""

    def __init__(self, case, second: int = 0, answered: bool = True):
        """answered=False: the answer is known not to come to an end."""
        self.case = case
        self.second = SECOND[second % len(SECOND)]
        self.answered = answered
        self.solved = case.replace(start="error") if kept_feasible(case) else case

    @cached_property
    def first(self) -> Outcome:
        return attempt(self.solved, FIRST, 1e-12) if self.answered else Outcome(told="no end")

    @cached_property
    def again(self) -> Outcome:
        return attempt(self.solved, self.second[0], self.tol(self.second[1]))

    def tol(self, tol: float) -> float:
        """tol for a scene of this unit, or this far from the origin: it is absolute, and relative
        to the largest coordinate."""
        x = self.first.traj.x if self.first.ok else self.case.x0[None]
        far = max(1.0, float(np.abs(x).max()) / max(self.unit, float(np.abs(x - x[0]).max())))
        return max(tol * self.unit / far, min(tol, 1e-13))

    @cached_property
    def unit(self) -> float:
        """The largest state, or what the drift makes of the time if that is more; at most 1."""
        x = self.first.traj.x if self.first.ok else self.case.x0
        t = self.case.t
        with np.errstate(all="ignore"):
            way = float(t[-1] - t[0]) * largest_speed(self.case.problem, float(t[0]), self.case.x0)
        return min(
            1.0, max(float(np.max(np.abs(x), initial=0.0)), way if np.isfinite(way) else 0.0) or 1.0
        )

    def apart(self, a, b, absolute: float = 0.0) -> float:
        """Difference of two runs, less what tolerances allow: states, and reactions where both have
        them."""
        allowed = max(self.round_off * self.growth, absolute)
        out = relative(a.x, b.x, self.unit, allowed)
        if a.reaction.shape == b.reaction.shape and np.isfinite(b.reaction).all():
            out = max(out, relative(a.reaction, b.reaction, self.unit, allowed))
        return out

    @cached_property
    def round_off(self) -> float:
        """1e-11 of the largest coordinate: tolerances are relative, and rounding adds up over steps
        and events."""
        x = self.first.traj.x if self.first.ok else self.case.x0
        return 1e-11 * float(np.abs(x).max(initial=0.0))

    @cached_property
    def growth(self) -> float:
        """What a later part of the run makes of a move by round_off, where that is more than the
        starts are moved by: at least 1.

        Far from the origin tolerances and roundings move the state at all times. The start alone
        does not show it: what the beginning forgets may be repelled later.
        """
        worst = 1.0
        rng = np.random.default_rng(1)
        case = self.solved
        if not self.first.ok or self.round_off <= NUDGE * self.unit:
            return worst
        for k in sorted({len(case.t) // 3, min(2 * len(case.t) // 3, len(case.t) - 2)}):
            x = self.first.traj.x[k:]
            move = self.round_off * rng.uniform(-1.0, 1.0, case.n)
            other = attempt(
                case.replace(t=case.t[k:], x0=x[0] + move, start=self._beside), FIRST, 1e-12
            )
            if other.ok:
                worst = max(worst, float(np.abs(other.traj.x - x).max()) / self.round_off)
        return worst

    @property
    def _beside(self) -> str:
        """How a start is taken that is moved."""
        feasible = isinstance(self.case.problem, Complementarity) and self.case.problem.constraints
        return "project" if feasible and self.solved.start == "error" else self.solved.start

    @cached_property
    def condition(self) -> float:
        """At least 1; infinite where a start beside this one does not run."""
        rng = np.random.default_rng(0)
        case = self.solved
        worst = 1.0
        nudge = max(NUDGE, self.round_off / self.unit)
        for _ in range(2):
            away = rng.uniform(-1.0, 1.0, case.n)
            other = attempt(
                case.replace(x0=case.x0 + nudge * self.unit * away, start=self._beside),
                FIRST,
                1e-12,
            )
            worst = max(
                worst,
                relative(other.traj.x, self.first.traj.x, self.unit) / nudge
                if other.ok
                else np.inf,
            )
        return worst

    @cached_property
    def bound(self) -> float:
        far = (
            float(np.abs(self.first.traj.x).max(initial=0.0)) / self.unit if self.first.ok else 1.0
        )
        return (BOUND + ROUNDINGS * EPS * far) * self.condition

    @cached_property
    def answer(self):
        """The trajectory that others are held against, or None."""
        trusted = self.first.ok and self.again.ok and self.condition < WILD
        if not (trusted and self.apart(self.again.traj, self.first.traj, ABSOLUTE) <= self.bound):
            return None
        if self.digits == 1e-12:
            return self.first.traj
        better = attempt(self.solved, FIRST, self.digits)
        return (
            better.traj
            if better.ok and self.apart(self.first.traj, better.traj, ABSOLUTE) <= self.bound
            else None
        )

    @cached_property
    def digits(self) -> float:
        """Tolerance of the answer: an absolute 1e-12 is much in a small unit."""
        return min(1e-12, max(1e-12 * self.unit, 1e-15)) if self.unit < 0.1 else 1e-12
