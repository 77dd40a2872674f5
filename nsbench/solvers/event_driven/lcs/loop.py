"""Integrate a linear complementarity system between events: linear arcs with fixed rows w = 0.

On an arc w = 0 on a set of rows I and lam = 0 elsewhere (see modes); it ends where w outside or lam
inside falls through zero. At an event every set is a candidate whose constraints the state
satisfies. A lam or w that vanishes there is decided by short trial motions: the first sign that
shows counts, which is the lexicographic order of the derivatives. No candidate, or several with
different motions, is a result: the run stops with a status.
"""

from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.case.scale import time_text
from nsbench.dynamics.lcs import certainly_unique
from nsbench.solvers.base import Run
from nsbench.solvers.event_driven.accumulation import accumulation
from nsbench.solvers.event_driven.lcs.linear_flow import (
    EPS,
    INTEGRALS,
    NODES,
    NOISE,
    LinearFlow,
    evaluate,
    first_crossing,
    is_resolved,
)
from nsbench.solvers.event_driven.lcs.modes import Inputs, build_mode
from nsbench.solvers.event_driven.smooth.stall import STALL_MESSAGE, StallDetector
from nsbench.trajectory import Event, Resolution, Status, Trajectory

MAX_ENUMERATED_ROWS = 6  # up to here all 2^m sets are candidates; beyond, those of implicit steps
FIRST_TRIAL = -8.0  # trial motions: powers of ten, from 1e-8 of the fastest time of the candidates
LONGEST_TRIAL = 1e-2  # to this part of the run: what vanishes so long counts as zero
ZERO_BAND = 1e-12  # of the terms of a sum: below, it is zero (4500 roundings)
START_BAND = 1e-9  # the same for the start, which may have been typed
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
        self.flows = {}
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
        self.modes_tried = 0
        self.h = 0.0
        self.trial_steps = 0  # of steps, each of which other integrators take many for
        # sampled: inputs at the samples, by order
        self.last_step = None
        self.uniqueness_unknown = False
        self.inputs_at_samples = {}

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
            if self.uniqueness_unknown:
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
            "inner_iterations": self.modes_tried,
            "loop": "host",
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

    def _flow(self, rows):
        """Return the flow with w = 0 on the rows, built once; None if they do not determine lam."""
        if rows not in self.flows:
            found = build_mode(self.system, rows)
            self.flows[rows] = (
                None
                if found is None
                else LinearFlow(found, self.inputs, self.options.method, self.tol)
            )
        return self.flows[rows]

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
        """Choose the rows that continue the motion, fewest undecided signs first."""
        flows = [f for f in (self._flow(rows) for rows in self._candidate_rows()) if f is not None]
        self.modes_tried += len(flows)
        flows = [f for f in flows if self._is_consistent(f, band)]
        span = self.T - float(self.case.t[0])
        fast = min([span, *(1.0 / f.fastest_rate for f in flows if f.fastest_rate > 0.0)])
        times = fast * 10.0 ** np.arange(FIRST_TRIAL, 1.0 + np.log10(LONGEST_TRIAL * span / fast))
        good = [
            (left, len(f.mode.rows), f.mode.rows, f)
            for f in flows
            if (left := self._count_undecided(f, band, times)) is not None
        ]
        if not good:
            return Status(
                "infeasible",
                f"At t = {self.now} no lambda continues the motion without a jump of the state.",
            )
        first, *others = (g[-1] for g in sorted(good, key=lambda g: g[:3]))
        for other in others:
            if self._motions_differ(first, other, times):
                return Status(
                    "degenerate",
                    f"At t = {self.now} several motions continue (rows {list(first.mode.rows)} "
                    f"or "
                    f"{list(other.mode.rows)} act): the solution is not unique there.",
                )
        self.flow = first
        return Status()

    def _candidate_rows(self):
        """List the sets of rows to try: all, or those of implicit steps of decreasing length."""
        if self.m <= MAX_ENUMERATED_ROWS:
            return [tuple(i for i in range(self.m) if (code >> i) & 1) for code in range(2**self.m)]
        from nsbench.lcp import lemke

        out = [] if self.flow is None else [self.flow.mode.rows]
        span = self.T - float(self.case.t[0])
        for h in span * 10.0 ** -np.arange(3.0, 9.0):
            W = np.linalg.inv(np.eye(self.n) - h * self.system.A)
            s = self.inputs(self.t + h, 0)[0]
            z = W @ (self.x + h * s[: self.n])
            G = h * W @ self.system.B
            M = self.system.D + self.system.C @ G
            r = self.system.C @ z + s[self.n :]
            a, b = lemke.scales(M)
            on = np.zeros(self.m, np.bool_)
            lam = np.zeros(self.m)
            if lemke.solve(M, r, a, b, on, lam, np.zeros(self.m))[0]:
                out.append(tuple(int(i) for i in np.flatnonzero(lam > 0.0)))
            if not self.uniqueness_unknown and not certainly_unique(M, G):
                self.uniqueness_unknown = True
        return list(dict.fromkeys(out))

    def _is_consistent(self, flow, band) -> bool:
        """Check that the state satisfies the constraints of the mode, with no lam or w negative."""
        off, size = flow.constraint_residual(self.t, self.x, (self.state_size, self.input_size))
        if np.any(np.abs(off) > band * size):
            return False
        x = flow.project(self.t, self.x, self.state_size)
        f, size = flow.sign_functions_at(self.t, x, (self.state_size, self.input_size))
        return bool(np.all(f >= -band * size))  # False where not finite

    def _count_undecided(self, flow, band, times) -> int | None:
        """Count the lam and w that vanish on the trial motions too; None if one turns negative."""
        x = flow.project(self.t, self.x, self.state_size)
        f, size = flow.sign_functions_at(self.t, x, (self.state_size, self.input_size))
        signs = np.where(f > band * size, 1, 0)
        for h in times:
            if np.all(signs > 0):
                break
            f, clear, _ = self._trial(flow, x, h)
            if not np.all(np.isfinite(f)):
                return None
            signs = np.where((signs == 0) & clear, np.sign(f), signs)
            if np.any(signs < 0):
                return None
            if np.any(clear & (f < 0.0)):  # one that was positive: from here another set acts
                break
        return int(np.count_nonzero(signs == 0))

    def _trial(self, flow, x, h):
        """Return lam and w after the time h in this mode, a mask of those above rounding, x."""
        X, _ = flow.collocate(self.t, x, h)
        f, size = flow.sign_functions_at(
            self.t + h, X[-1], (np.maximum(self.state_size, np.abs(X[-1])), self.input_size)
        )
        return f, np.abs(f) > ZERO_BAND * size, X[-1]

    def _motions_differ(self, a, b, times) -> bool:
        """Check whether the motions of two modes differ while both are admissible."""
        xa, xb = (f.project(self.t, self.x, self.state_size) for f in (a, b))
        for h in times:
            fa, clear_a, ya = self._trial(a, xa, h)
            fb, clear_b, yb = self._trial(b, xb, h)
            if np.any(clear_a & (fa < 0.0)) or np.any(clear_b & (fb < 0.0)):
                return False
            if np.any(np.abs(ya - yb) > ZERO_BAND * self.state_size):
                return True
        return False


def _multipliers_at_nodes(F, rows):
    """Return lam at the nodes: the sign functions of the rows, zero elsewhere."""
    out = np.zeros_like(F)
    out[:, list(rows)] = F[:, list(rows)]
    return out
