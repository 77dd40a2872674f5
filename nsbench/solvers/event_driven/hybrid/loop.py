"""Event-driven method on hybrid systems: smooth arcs in one mode, joined by transitions.

On an arc the drift of the mode is integrated up to the first guard that passes zero, to the
tolerance (nsbench.solvers.event_driven.smooth). There the transition is made, its reset included,
and then every other one that its target mode makes at the same instant. Samples at an instant of
transitions hold the last state; the first sample is the start as it is given.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from nsbench.case import Case
from nsbench.case.scale import time_text
from nsbench.compilation.case_functions import in_python
from nsbench.dynamics.hybrid import EPS, HybridSystem
from nsbench.problem import Hybrid
from nsbench.solvers.base import Run
from nsbench.solvers.event_driven.accumulation import MAX_EVENTS_AT_ONE_INSTANT, accumulation
from nsbench.solvers.event_driven.filippov.mode_search import LOCATED
from nsbench.dynamics.interval_taylor import SPACE
from nsbench.solvers.event_driven.smooth.arc import UNPROVEN_PARTS, integrate_to_event
from nsbench.trajectory import Event, Resolution, Status, Trajectory

ARC_BAND = 16.0  # roundings of a guard below which it is not armed at the start of an arc
SAME_INSTANT = 10.0  # tolerances: events that are less apart are one instant
# An event is unresolved if its guard stayed within rounding of zero since the last one, on an arc
# of at most this part of the own time (the root of the rounding, and some room): such arcs have no
# lengths that can be compared. At the first of them the geometric series of the lengths before is
# carried on, over as much; where there is none, so many of the last events accumulate.
UNRESOLVED_LENGTH = 1e-5
MAX_UNRESOLVED_EVENTS = 20
LAST_EVENTS = 40
SHOWN = 6  # transitions of a circle that a sentence names


def prepare(case: Case, options, tol: float) -> Run:
    """Prepare a run of a hybrid case; options are EventDriven's, tol is the tolerance of the arcs.

    Its trajectory has the time spent in each mode as impulse, and events "transition" with contact
    (0, k) for transition k.
    """
    return lambda: HybridIntegrator(case, options, tol).run()


def interval_functions(problem: Hybrid) -> list:
    """List by mode a function (t, x) -> [drift, guards of the mode] over Jets."""

    def functions(name):
        drift = problem.modes[name](SPACE)
        guards = [tr.guard(SPACE) for tr in problem.transitions if tr.source == name]
        return lambda t, x: [drift(t, x), *(guard(t, x) for guard in guards)]

    return [functions(name) for name in problem.modes]


class HybridIntegrator:
    """One run: the state and the mode, its arcs, and what is recorded of them."""

    def __init__(self, case: Case, options, tol: float):
        self.case = case
        self.options = options
        self.tol = tol
        self.system = HybridSystem(case.problem)
        self.t = float(case.t[0])
        self.x = case.x0.copy()
        self.mode = self.system.initial
        self.spent = np.zeros(len(self.system.names))
        self.done = 1
        self.X = np.full((len(case.t), case.n), np.nan)
        self.W = np.full((len(case.t), self.spent.size), np.nan)
        self.events = []
        self.instants = []
        self.passed = set()  # guards that fire no more before they were negative
        self.unresolved = deque(maxlen=LAST_EVENTS)
        self.ends = None
        self.arcs = 0
        self.steps = 0
        self.h = 0.0
        self.proof = {"unproven": 0, "refused": 0, "touches": 0}
        self.interval_functions = None

    def run(self) -> Trajectory:
        """Follow the motion from the start of the case to its end or a failure."""
        case = self.case
        with np.errstate(all="ignore"):
            self.X[0] = self.x
            self.W[0] = 0.0
            status = self._make_transitions(self._due(ARC_BAND * EPS), ARC_BAND * EPS)
            while status.ok and self.t < case.t[-1]:
                status = self._follow_arc()
        if status.ok:  # an event at the very end leaves the last sample to us
            self.X[self.done :] = self.x
            self.W[self.done :] = self.spent
        contacts = case.problem.contacts
        return Trajectory(
            case.t,
            self.X,
            contacts,
            self.W[:, : len(contacts)],
            np.empty((len(case.t), 0)),
            status,
            tuple(self.events),
            self._stats(),
            "mean",
            resolution=Resolution(),
        )

    def _stats(self) -> dict:
        stats = {
            "steps": self.steps,
            "h": float(self.h),
            "drift_calls": self.system.calls,
            "events": len(self.events),
            "restarts": self.arcs,
            **in_python("hybrid systems have no compiled loop"),
            "roots": "sampled" if self.proof["unproven"] else "verified",
            **self.proof,
        }
        if self.ends is not None:
            stats["accumulation"] = float(self.ends)
        return stats

    def _follow_arc(self) -> Status:
        """Follow the mode to its first event or the end, then make the transitions there."""
        case = self.case
        system = self.system
        mode = self.mode
        own = system.leaving[mode]
        # a guard that has passed is watched for its return below zero
        signs = np.array([1.0 if k in self.passed else -1.0 for k in own])
        bands = np.array(
            [ARC_BAND * EPS * system.guard_size(k, self.t, self.x).terms for k in own]
        )
        arc = integrate_to_event(
            lambda t, x: system.velocity(mode, t, x),
            self.t,
            self.x,
            case.t[-1],
            (lambda t, x: signs * [system.guard(k, t, x) for k in own]) if own else None,
            method=self.options.method,
            rtol=self.tol,
            atol=self.tol,
            max_step=self.options.max_step,
            max_steps=self.options.max_steps - self.steps,
            band=bands,
            samples=case.t[self.done :],
            max_unproven=case.own_time / UNPROVEN_PARTS,
            data=self._data(mode),
        )
        length = arc.t - self.t
        self._record(arc)
        if not arc.status.ok or not arc.fired.size:
            return arc.status
        first = int(arc.fired.item())
        self._pass_jump(own[first], signs[first], bands[first])
        if own[first] in self.passed:
            self.passed.remove(own[first])
            return Status()
        # a guard that is not armed fires a band beyond zero; one that jumps is farther beyond
        beyond = system.guard(own[first], self.t, self.x) / bands[first]
        is_short = length <= UNRESOLVED_LENGTH * case.own_time
        self.unresolved.append(is_short and 0.5 < beyond < 2.0)
        tolerance = max(SAME_INSTANT * self.tol, ARC_BAND * EPS)
        # of several guards that pass zero at one instant the first of the list fires
        earlier = self._due(tolerance, own[:first])
        return self._pass_instant(own[first] if earlier is None else earlier, tolerance)

    def _pass_jump(self, k: int, sign: float, band: float) -> None:
        """Go past the jump of guard k over zero, where it jumps rather than passes.

        A root of a function that jumps is located to LOCATED of the own time, before or after it.
        The jump is bisected along the tangent of the motion, to adjacent times; sign times the
        guard is positive before it.
        """
        velocity = self.system.velocity(self.mode, self.t, self.x)
        at = lambda t: sign * self.system.guard(k, t, self.x + (t - self.t) * velocity)
        low = self.t
        high = min(self.t + LOCATED * self.case.own_time, float(self.case.t[-1]))
        if not (at(low) > band and at(high) < 0.0):
            return
        while low < (middle := 0.5 * (low + high)) < high:
            if at(middle) > 0.0:
                low = middle
            else:
                high = middle
        self.spent[self.mode] += high - self.t
        self.x = self.x + (high - self.t) * velocity
        self.t = high

    def _data(self, mode: int):
        """Return the drift and the guards of the mode over Jets, for the proofs of the arc."""
        if self.interval_functions is None:
            self.interval_functions = interval_functions(self.case.problem)
        return self.interval_functions[mode]

    def _record(self, arc) -> None:
        """Record the samples of an arc and go to its end."""
        rows = slice(self.done, self.done + len(arc.samples))
        self.X[rows] = arc.samples
        self.W[rows] = self.spent
        self.W[rows, self.mode] += self.case.t[rows] - self.t
        self.spent[self.mode] += arc.t - self.t
        self.done = rows.stop
        self.steps += arc.steps
        self.h = max(self.h, arc.h)
        self.arcs += 1
        for name in self.proof:
            self.proof[name] += getattr(arc, name)
        self.t = float(arc.t)
        self.x = arc.y

    def _due(self, tolerance: float, among: list[int] | None = None) -> int | None:
        """Return the first transition of the mode that fires here, or None."""
        among = self.system.leaving[self.mode] if among is None else among
        return next((k for k in among if k not in self.passed and self._is_due(k, tolerance)), None)

    def _is_due(self, k: int, tolerance: float) -> bool:
        args = self.mode, self.t, self.x, tolerance, self.case.own_time
        return self.system.is_due(k, *args)

    def _make_transitions(self, k: int | None, tolerance: float) -> Status:
        """Make transition k, and all that follow from it at the same instant."""
        made = []
        limit = MAX_EVENTS_AT_ONE_INSTANT + 2 * len(self.system.transitions)
        while k is not None:
            made.append(k)
            self.events.append(Event(self.t, "transition", (0, k)))
            before = self.x
            self.x = self.system.after(k, self.t, before)
            self.mode = self.system.targets[k]
            states = before, self.x
            self.passed = self.system.passed_guards(self.passed, k, self.t, states, tolerance)
            if k in self.passed and not self._is_due(k, tolerance):
                self.passed.remove(k)  # the motion turns back, as after an impact
            if not np.all(np.isfinite(self.x)):
                return Status(
                    "nan",
                    f"The state after the transition {self.system.name_of(k)} is not finite at "
                    f"t = {time_text(self.t)}.",
                )
            if len(made) > limit:
                circle = ", ".join(self.system.name_of(k) for k in made[-SHOWN:])
                return Status(
                    "chatter",
                    f"More than {limit} transitions follow one another at t = {time_text(self.t)}: "
                    f"{circle}: a circle without time between. A relay without hysteresis is a "
                    "Filippov system.",
                )
            k = self._due(tolerance)
        return Status()

    def _accumulation(self) -> float | None:
        """Return the time at which the transitions accumulate, once that is certain."""
        own_time = self.case.own_time
        ends = accumulation(self.instants, own_time)
        if ends is None and self.unresolved[-1]:
            ends = accumulation(self.instants[:-1], own_time, UNRESOLVED_LENGTH)
        if ends is None and sum(self.unresolved) > MAX_UNRESOLVED_EVENTS:
            return self.t
        return ends

    def _pass_instant(self, k: int, tolerance: float) -> Status:
        """Make the transitions of this instant; Chatter if instants accumulate or are too many."""
        status = self._make_transitions(k, tolerance)
        if not status.ok:
            return status
        # the event is known to this tolerance: samples that close before it are at it
        close = self.t - self.case.t[: self.done] <= tolerance * self.case.own_time
        close[0] = False
        self.X[: self.done][close] = self.x
        self.instants.append(self.t)
        self.ends = ends = self._accumulation()
        if ends is not None:
            return Status(
                "chatter",
                f"Transitions accumulate at t = {time_text(ends)}: following events cannot pass "
                "that time.",
            )
        if len(self.events) > self.options.max_events:
            return Status(
                "chatter",
                f"{len(self.events)} transitions were made by t = {time_text(self.t)}; raise "
                "max_events.",
            )
        return Status()
