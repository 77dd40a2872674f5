"""Explicit Euler on hybrid systems: transitions at the end of the step in which a guard rose.

    y = x + h f_m(t, x);    at t + h: transition k of m if c_k(t + h, y) > max(0, c_k(t, x))

The state has passed the guard by O(h) when the transition is made, so that times of transitions
and states are of order one; how late a transition is within its step has no rule, so that errors
scatter below a multiple of h. A guard that is positive already when its mode is entered fires at
once if that is more than what the step moved it by; else only the overshoot made it positive, and
it fires after a step in which it rises.
"""

from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.case.scale import time_text
from nsbench.compilation.case_functions import in_python
from nsbench.dynamics.hybrid import EPS, HybridSystem
from nsbench.solvers.base import Grid, last_steps
from nsbench.solvers.common.divergence import ended
from nsbench.solvers.common.time_grid import samples
from nsbench.trajectory import Event, Resolution, Status, Trajectory

MAX_TRANSITIONS_OF_A_STEP = 100  # besides two for each transition of the system
ROUNDING = 16.0 * EPS  # of a guard: less is no change of it
LARGEST_STATE = 1e150  # as in the compiled loop: beyond, squares overflow


class HybridEuler:
    """One run over the grid g: the state and the mode, and what is recorded of them."""

    def __init__(self, case: Case, g: Grid):
        self.case = case
        self.g = g
        self.system = HybridSystem(case.problem)
        self.x = case.x0.copy()
        self.mode = self.system.initial
        self.passed = set()  # guards that fire no more before they were negative
        self.spent = np.zeros(len(self.system.names))
        self.known = None  # time, mode and guards at the end of the last step without a transition
        self.events = []
        self.X = np.full((len(g.t), case.n), np.nan)
        self.W = np.full((len(g.t), self.spent.size), np.nan)

    def run(self) -> Trajectory:
        """March over the grid; return the trajectory."""
        with np.errstate(all="ignore"):
            status = self._march()
        g = self.g
        contacts = self.case.problem.contacts
        X = self.X
        W = self.W[:, : len(contacts)]
        lam = last_steps(self.case.t, g, W)
        if not g.aligned:
            X, W = samples(self.case.t, g.t, X, W)
        stats = {
            "steps": int(g.substeps.sum()),
            "h": g.h,
            "drift_calls": self.system.calls,
            "events": len(self.events),
            **in_python("hybrid systems have no compiled loop"),
        }
        return Trajectory(
            self.case.t,
            X,
            contacts,
            W,
            np.empty((len(X), 0)),
            status,
            tuple(self.events),
            stats,
            "start",
            **lam,
            resolution=Resolution(step=g.h, rule="explicit"),
        )

    def _march(self) -> Status:
        """Take all steps; return the status."""
        g = self.g
        self.X[0] = self.x
        self.W[0] = 0.0
        status = self._make_transitions(float(g.t[0]), self._due(float(g.t[0]), {}), {})
        # Explicit Euler with equal steps between two recorded times.
        for k, steps in enumerate(g.substeps.tolist()):
            h = float(g.t[k + 1] - g.t[k]) / steps
            for j in range(steps):
                if not status.ok:
                    return status
                t = float(g.t[k]) + j * h
                is_last = j + 1 == steps
                # the end of a step is the start of the next one to the bit: guards are kept
                status = self._step(t, h, float(g.t[k + 1] if is_last else g.t[k] + (j + 1) * h))
            if status.ok:
                self.X[k + 1] = self.x
                self.W[k + 1] = self.spent
        return status

    def _step(self, t: float, h: float, after: float) -> Status:
        """Take one step from t and make the transitions at its end, `after`."""
        system = self.system
        start = self.x
        before = self._guards_at_start(t)
        y = start + h * system.velocity(self.mode, t, start)
        self.spent[self.mode] += h
        if not np.all(np.abs(y) <= LARGEST_STATE):
            return ended(self.x[None], self.case.x0, t, t)
        self.x = y
        reached = {k: system.guard(k, after, y) for k in before}
        self.known = after, self.mode, reached
        self.passed = {k for k in self.passed if reached[k] > 0.0}
        fired = [
            k
            for k in system.leaving[self.mode]
            if reached[k] > max(0.0, before[k]) and k not in self.passed
        ]
        if not fired:
            return self._make_transitions(after, fired, {})
        every = range(len(system.transitions))
        moved = {k: abs(system.guard(k, after, y) - system.guard(k, t, start)) for k in every}
        self.known = None
        return self._make_transitions(after, fired, moved)

    def _guards_at_start(self, t: float) -> dict[int, float]:
        """Return the guards that leave the mode at (t, x), from the step before where it ended
        there."""
        if self.known is not None:
            at, mode, values = self.known
            if at == t and mode == self.mode:
                return values
        return {k: self.system.guard(k, t, self.x) for k in self.system.leaving[self.mode]}

    def _make_transitions(self, t: float, fired: list[int], moved: dict[int, float]) -> Status:
        """Make the first transition that fired, and all that are due in the modes it leads to.

        moved: by how much the step moved each guard.
        """
        system = self.system
        limit = MAX_TRANSITIONS_OF_A_STEP + 2 * len(system.transitions)
        todo = fired
        made = 0
        while todo:
            k = todo[0]
            made += 1
            self.events.append(Event(t, "transition", (0, k)))
            states = self.x, system.after(k, t, self.x)
            self.passed = system.passed_guards(self.passed, k, t, states, ROUNDING)
            self.mode = system.targets[k]
            self.x = states[1]
            if k in self.passed and not system.rate(k, self.mode, t, self.x, self.g.h) > 0.0:
                self.passed.remove(k)  # the motion turns back, as after an impact
            if not np.all(np.abs(self.x) <= LARGEST_STATE):
                return Status(
                    "nan",
                    f"The state after the transition {system.name_of(k)} is not finite at "
                    f"t = {time_text(t)}.",
                )
            if made > limit:
                return Status(
                    "chatter",
                    f"More than {limit} transitions follow one another at t = {time_text(t)}, the "
                    f"last one {system.name_of(k)}: a circle without time between.",
                )
            todo = self._due(t, moved)
        return Status()

    def _due(self, t: float, moved: dict[int, float]) -> list[int]:
        """List the transitions of the mode whose guards are positive by more than the overshoot."""
        system = self.system
        return [
            k
            for k in system.leaving[self.mode]
            if system.guard(k, t, self.x) > moved.get(k, 0.0) and k not in self.passed
        ]
