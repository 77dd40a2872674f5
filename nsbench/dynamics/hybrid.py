"""Numerical evaluation of a hybrid system: drifts, guards and resets by number, in numpy.

Guards are taken with the sign of their direction, so that each fires where it rises through zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.compilation.factories import as_numpy
from nsbench.problem import Hybrid

EPS = float(np.finfo(float).eps)
SLOPE_STEP = 1e-7  # relative to a coordinate, or part of the own time: of one-sided differences
RATE_NOISE = 8.0 * EPS  # of the size of a guard: two values that differ by less are one


@dataclass(frozen=True)
class GuardSize:
    """Size of the terms of a guard at a state.

    value: |c|. slopes (n,): |dc/dx_i|. pace: |dc/dt|. state (n,), time: moduli of x and t.
    """

    value: float
    slopes: np.ndarray
    pace: float
    state: np.ndarray
    time: float

    @property
    def terms(self) -> float:
        """Return what rounding and tolerances are relative to: moduli below 1 count as 1.

        A step that passes a small state is rounded as the states are that it comes from.
        """
        return float(self.value + self.slopes @ (1.0 + self.state) + self.pace * (1.0 + self.time))


class HybridSystem:
    """Drifts by mode and guards by transition, both by number, as functions of (t, x).

    leaving: for each mode the numbers of the transitions that leave it, in the order of the list.
    calls: of drifts so far.
    """

    def __init__(self, problem: Hybrid):
        number = {name: i for i, name in enumerate(problem.modes)}
        self.names = problem.names
        self.transitions = problem.transitions
        self.initial = number[problem.initial]
        self.sources = [number[tr.source] for tr in problem.transitions]
        self.targets = [number[tr.target] for tr in problem.transitions]
        self.leaving = [
            [k for k, tr in enumerate(problem.transitions) if tr.source == name]
            for name in problem.modes
        ]
        self.calls = 0
        self._drifts = [as_numpy(f) for f in problem.modes.values()]
        self._guards = [as_numpy(tr.guard) for tr in problem.transitions]
        self._resets = [tr.reset and as_numpy(tr.reset) for tr in problem.transitions]

    def velocity(self, mode: int, t: float, x: np.ndarray) -> np.ndarray:
        """Return x' (n,) in the mode."""
        self.calls += 1
        return np.asarray(self._drifts[mode](t, x), float)

    def guard(self, k: int, t: float, x: np.ndarray) -> float:
        """Return guard k: negative before its transition."""
        return self.transitions[k].direction * float(np.asarray(self._guards[k](t, x)).item())

    def after(self, k: int, t: float, x: np.ndarray) -> np.ndarray:
        """Return the state (n,) after transition k, from the one before."""
        reset = self._resets[k]
        return x.copy() if reset is None else np.array(reset(t, x.copy()), float)

    def passed_guards(
        self, passed: set[int], k: int, t: float, states: tuple[np.ndarray, np.ndarray], band: float
    ) -> set[int]:
        """Return the guards that have passed after transition k, if it leads to its own mode.

        passed: those before it. states: before and after the reset. A guard that the reset does not
        change, to `band` of its size, is on its way through zero still: that is one event. What
        leaves the mode and returns enters it anew: there no guard has passed.
        """
        before, after = states
        if self.targets[k] != self.sources[k]:
            return set()
        return {
            j
            for j in passed | {k}
            if abs(self.guard(j, t, after) - self.guard(j, t, before))
            <= band * self.guard_size(j, t, after).terms
        }

    def name_of(self, k: int) -> str:
        """Return transition k in words."""
        transition = self.transitions[k]
        return f"{transition.source} -> {transition.target}"

    def guard_size(self, k: int, t: float, x: np.ndarray) -> GuardSize:
        """Return the sizes of the terms of guard k, by one-sided differences."""
        value = self.guard(k, t, x)
        slopes = np.empty(x.size)
        for i in range(x.size):
            step = SLOPE_STEP * (1.0 + abs(x[i]))
            moved = x.copy()
            moved[i] += step
            slopes[i] = abs(self.guard(k, t, moved) - value) / step
        step = SLOPE_STEP * (1.0 + abs(t))
        pace = abs(self.guard(k, t + step, x) - value) / step
        return GuardSize(abs(value), slopes, pace, np.abs(x), abs(t))

    def is_due(
        self, k: int, mode: int, t: float, x: np.ndarray, tolerance: float, own_time: float
    ) -> bool:
        """Does transition k fire at (t, x), on entering its source mode or at an event of another?

        tolerance: what the state is known to, relative to its size or 1. A guard that is positive
        beyond it fires. One within it fires if it rises, so that it is positive a `tolerance` of
        the own time later: the two events are one instant.
        """
        size = self.guard_size(k, t, x)
        value = self.guard(k, t, x)
        band = tolerance * size.terms
        if abs(value) > band or not np.isfinite(value):
            return value > band
        rate = self.rate(k, mode, t, x, SLOPE_STEP * own_time)
        return rate > 0.0 and value + rate * tolerance * own_time > 0.0

    def rate(self, k: int, mode: int, t: float, x: np.ndarray, step: float) -> float:
        """Return the rate of guard k along the motion in the mode, by a difference over `step`.

        Zero where it is rounding.
        """
        change = self.guard(k, t + step, x + step * self.velocity(mode, t, x))
        change -= self.guard(k, t, x)
        noise = RATE_NOISE * self.guard_size(k, t, x).terms
        return change / step if abs(change) > noise else 0.0
