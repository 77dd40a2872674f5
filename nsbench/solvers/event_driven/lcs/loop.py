"""Integrate a linear complementarity system between events: linear arcs with fixed rows w = 0.

On an arc w = 0 on a set of rows I and lam = 0 elsewhere (see modes); it ends where w outside or lam
inside falls through zero. There row_choice finds the set of the next arc.
"""

from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.case.scale import time_text
from nsbench.compilation.case_functions import in_python
from nsbench.solvers.base import Run
from nsbench.solvers.event_driven.accumulation import accumulation
from nsbench.solvers.event_driven.lcs.linear_flow import (
    EPS,
    INTEGRALS,
    NODES,
    NOISE,
    evaluate,
    first_crossing,
    is_resolved,
)
from nsbench.solvers.event_driven.lcs.modes import Inputs
from nsbench.solvers.event_driven.lcs.row_choice import (
    MAX_ENUMERATED_ROWS,
    ZERO_BAND,
    Point,
    RowChoice,
)
from nsbench.solvers.event_driven.smooth.stall import STALL_MESSAGE, StallDetector
from nsbench.trajectory import Event, Resolution, Status, Trajectory

START_BAND = 1e-9  # as ZERO_BAND, for the start, which may have been typed
STEP_SHARE = 1e-2  # of the tolerance for the last coefficients of one step: a run takes tens
# Growth of a state in one step, so that STEP_SHARE of the tolerance is relative to its start
MAX_GROWTH = 100.0
# part of the run below which a step is not halved, if the clock knows it: an input jumps
MIN_STEP = 1e-13
MAX_IDLE_EVENTS = 1000  # events in a row that leave the set as it is


def prepare(case: Case, options, tol: float) -> Run:
    """Prepare a run of an LCS; options: an EventDriven method, tol: tolerance of the run.

    Events: "contact" (lam_i becomes active) and "release", of contact (0, i).
    """
    import scipy.linalg  # noqa: F401  (loaded here, not in the timed run)

    return lambda: LcsIntegrator(case, options, tol).run()


class LcsIntegrator:
    """Integrate one run: its state, mode and recorded results."""

    def __init__(self, case: Case, options, tol: float):
        self.case = case
        self.system = case.problem
        self.options = options
        self.tol = tol
        self.n, self.m = self.system.B.shape
        self.t = float(case.t[0])
        self.T = float(case.t[-1])
        self.x = case.x0.copy()
        self.inputs = Inputs(self.system)
        self.choice = RowChoice(case, self.inputs, options.method, tol)
        self.flow = None
        self.stalls = StallDetector(self.t, self.T - self.t)
        self.min_step = max(
            MIN_STEP * (self.T - self.t), 4.0 * np.spacing(max(abs(self.t), abs(self.T)))
        )
        self.total = np.zeros(self.m)
        self.X = np.full((len(case.t), self.n), np.nan)
        self.P = np.full((len(case.t), self.m), np.nan)
        self.X[0] = self.x
        self.P[0] = 0.0
        self.recorded = 1
        with np.errstate(all="ignore"):
            self.state_size, self.input_size = self._initial_sizes()
        self.events = []
        self.event_times = []
        self.idle_events = 0
        self.steps = 0
        self.arcs = 0
        self.h = 0.0
        self.trial_steps = 0  # of steps, each of which other integrators take many for
        self.last_step = None
        self.inputs_at_samples = {}  # by order of the mode

    now = property(lambda self: time_text(self.t))  # the present time in words

    def run(self) -> Trajectory:
        """Integrate to the end or to a failure; return the trajectory."""
        with np.errstate(all="ignore"):
            status = self._choose_rows(START_BAND)
            while status.ok and self.t < self.T:
                status = self._follow_arc()
        if status.ok:
            self.X[self.recorded :] = self.x
            self.P[self.recorded :] = self.total
            if self.choice.uniqueness_unknown:
                status = Status(
                    "unverified",
                    f"With more than {MAX_ENUMERATED_ROWS} rows that are neither of a P-matrix nor "
                    "passive it is not known whether another motion exists.",
                )
        acted = np.flatnonzero(np.any(self.P > 0.0, axis=0))
        stats = {
            "steps": self.steps,
            "h": float(self.h),
            "events": len(self.events),
            "restarts": self.arcs,
            "inner_iterations": self.choice.modes_tried,
            **in_python("the collocation of linear complementarity systems is not compiled"),
        }
        return Trajectory(
            self.case.t,
            self.X,
            tuple((0, int(i)) for i in acted),
            self.P[:, acted],
            self.P @ self.system.B.T,
            status,
            tuple(self.events),
            stats,
            "mean",
            resolution=Resolution(),
        )

    def _initial_sizes(self):
        """Estimate sizes of the states (n,), positive, and of the inputs u, q (n + m,).

        Inputs: their largest finite value at the recorded times. State j: its start, or what alone
        balances an input, max_i |q_i / C_ij|; zero by both: as far as u_j moves it until the end;
        moved by nothing: the largest other one, or 1.
        """
        C = self.system.C
        values = np.abs([self.inputs(t, 0)[0] for t in self.case.t])
        input_size = np.where(np.isfinite(values), values, 0.0).max(axis=0)
        slope = np.abs(np.where(C != 0.0, C, 1.0))
        balance = np.where(C != 0.0, input_size[self.n :, None] / slope, 0.0)
        size = np.maximum(np.abs(self.x), balance.max(axis=0, initial=0.0))
        size = np.maximum(size, np.where(size > 0.0, 0.0, input_size[: self.n] * (self.T - self.t)))
        return np.where(size > 0.0, size, size.max(initial=0.0) or 1.0), input_size

    def _follow_arc(self) -> Status:
        """Integrate with the rows to the next event or the end, then choose the next rows."""
        flow = self.flow
        self.arcs = self.arcs + 1
        flow.state_size = self.state_size
        self.x = flow.project(self.t, self.x, self.state_size)
        f, size = flow.sign_functions_at(self.t, self.x, (self.state_size, self.input_size))
        armed = f > ZERO_BAND * size
        function_size = np.zeros(self.m)
        span = self.T - float(self.case.t[0])
        h = self.last_step or span
        # Step control: halve unresolved steps, double those that half of the nodes resolve.
        while self.t < self.T:
            h = min(h, span, self.options.max_step)
            if self.steps >= self.options.max_steps:
                return Status("maxiter", f"{self.steps} steps were taken by t = {self.now}.")
            if self.stalls(self.trial_steps, self.t):
                return Status("maxiter", STALL_MESSAGE.format(self.now))
            X, s = flow.step(self.t, self.x, h)
            self.steps = self.steps + flow.steps
            self.trial_steps = self.trial_steps + 1
            F = flow.sign_functions(X, s)
            if not (np.all(np.isfinite(X)) and np.all(np.isfinite(F))):
                if h > self.min_step:
                    h *= 0.25
                    continue
                return self._failure_status()
            state_max = np.maximum(self.state_size, np.abs(X).max(axis=0))
            function_max = np.maximum(function_size, np.abs(F).max(axis=0))
            terms = np.concatenate((state_max, np.maximum(size, function_max)))
            limit = (
                STEP_SHARE * self.tol * np.concatenate((state_max, function_max))
                + NOISE * EPS * terms
            )
            good, easy = is_resolved(np.hstack([X, F]), limit)
            good = (
                good
                and bool(np.all(state_max <= MAX_GROWTH * self.state_size))
                and self._inputs_resolved(flow, s, h, state_max, function_max)
            )
            if not good and h > self.min_step:
                h *= 0.5
                continue
            self.h = max(self.h, h)
            function_size = function_max
            status, fired = self._advance(flow, X, F, h, armed, size)
            if not status.ok or fired:
                self.last_step = h
                return self._end_arc() if status.ok else status
            f, size = flow.sign_functions_at(self.t, self.x, (self.state_size, self.input_size))
            armed |= f > ZERO_BAND * size
            h = 2.0 * h if easy else h
        self.last_step = h
        return Status()

    def _inputs_resolved(self, flow, s, h, state_max, function_max) -> bool:
        """Check that the polynomials of a step resolve the inputs, also at the samples in it."""
        inside = slice(*np.searchsorted(self.case.t, (self.t, self.t + h), side="right"))
        order = flow.mode.order
        if order not in self.inputs_at_samples:
            self.inputs_at_samples[order] = np.array([self.inputs(t, order) for t in self.case.t])
        x, f = flow.input_error(
            self.t, s, h, (self.case.t[inside], self.inputs_at_samples[order][inside])
        )
        return bool(np.all(x <= self.tol * state_max) and np.all(f <= self.tol * function_max))

    def _failure_status(self):
        """Return the status of a state or input that is not finite."""
        if np.abs(self.x).max() > 1e150:
            return Status("diverged", f"The state passed 1e150 at t = {self.now}.")
        return Status(
            "nan", f"The inputs u and q, or the state, are not finite after t = {self.now}."
        )

    def _advance(self, flow, X, F, h, armed, size):
        """Record samples to the first event of a step; return (status, event reached)."""
        level = np.where(armed, 0.0, -ZERO_BAND * size)
        found = first_crossing(F, level)
        reach = 1.0 if found is None else found[0]
        end = self.t + 0.5 * h * (1.0 + reach)
        cut = end > self.T or (found is None and abs(end - self.T) <= 4.0 * np.spacing(abs(self.T)))
        if cut:
            end = self.T
            found = None
        P = self.total + h * (INTEGRALS @ _multipliers_at_nodes(F, flow.mode.rows))
        while self.recorded < len(self.case.t) and self.case.t[self.recorded] <= end:
            at = 2.0 * (self.case.t[self.recorded] - self.t) / h - 1.0
            self.X[self.recorded] = evaluate(X, at)
            self.P[self.recorded] = evaluate(P, at)
            self.recorded += 1
        at = 2.0 * (end - self.t) / h - 1.0
        if at >= 1.0:
            self.x = X[-1].copy()
            self.total = P[-1].copy()
        else:
            self.x = evaluate(X, at)
            self.total = evaluate(P, at)
        self.t = end
        self.state_size = np.maximum(
            self.state_size, np.abs(np.vstack([X[NODES <= at], self.x])).max(axis=0)
        )  # no size beyond an event
        if not np.all(np.isfinite(self.x)):
            return self._failure_status(), False
        return Status(), found is not None

    def _end_arc(self) -> Status:
        """Record the event, choose the next rows, and check for accumulation of events."""
        self.event_times.append(self.t)
        ends = accumulation(self.event_times, self.case.own_time)
        if ends is not None:
            return Status("chatter", f"Events accumulate at t = {time_text(ends)}: no way on.")
        if len(self.event_times) > self.options.max_events:
            return Status(
                "chatter",
                f"{len(self.event_times)} events were met by t = {self.now}; raise max_events.",
            )
        old = set(self.flow.mode.rows)
        status = self._choose_rows(ZERO_BAND)
        if not status.ok:
            return status
        new = set(self.flow.mode.rows)
        self.events += [Event(self.t, "contact", (0, int(i))) for i in sorted(new - old)]
        self.events += [Event(self.t, "release", (0, int(i))) for i in sorted(old - new)]
        self.idle_events = self.idle_events + 1 if old == new else 0
        if self.idle_events > MAX_IDLE_EVENTS:
            return Status(
                "chatter",
                f"{MAX_IDLE_EVENTS} events up to t = {self.now} changed nothing: lam or w stays "
                "within rounding of zero.",
            )
        return Status()

    def _choose_rows(self, band) -> Status:
        """Choose the rows that continue the motion from here; return ok, or why there are none."""
        point = Point(self.t, self.x, (self.state_size, self.input_size))
        flow, status = self.choice.choose(point, self.flow, band)
        self.flow = flow if status.ok else self.flow
        return status


def _multipliers_at_nodes(F, rows):
    """Return lam at the nodes: the sign functions of the rows, zero elsewhere."""
    out = np.zeros_like(F)
    out[:, list(rows)] = F[:, list(rows)]
    return out
