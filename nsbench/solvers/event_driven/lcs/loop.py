"""The event-driven method on linear complementarity systems: linear arcs with a fixed set of
conducting rows.

On an arc w = 0 on a set I and lam = 0 elsewhere (see _modes); it ends where w outside or lam inside
falls through zero.
At an event every set is a candidate whose constraints the state satisfies; a lam or w that vanishes
there is decided by short trial motions: the first sign shown counts, which is the lexicographic
order of the derivatives. No candidate, or several with different motions, is an answer: the run
says so and stops.
"""

from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.dynamics.lcs import certainly_unique
from nsbench.solvers.base import Run
from nsbench.solvers.event_driven.filippov.host_loop import accumulation
from nsbench.solvers.event_driven.lcs.linear_flow import (
    EPS,
    NOISE,
    SUM,
    LinearFlow,
    S,
    crossing,
    resolved,
    value,
)
from nsbench.solvers.event_driven.lcs.modes import Inputs, mode
from nsbench.solvers.event_driven.smooth.arc import CREEPS, StallDetector
from nsbench.trajectory import Event, Resolution, Status, Trajectory

ALL = 6  # rows whose 2^m sets are all candidates; with more, those of short implicit steps
FIRST = -8.0  # trial motions: powers of ten, from 1e-8 of the fastest time of the candidates
LONGEST = 1e-2  # to this part of the run: what vanishes so long counts as zero
BAND = 1e-12  # of the terms of a sum: below, it is zero (4500 roundings)
START = 1e-9  # the same for the start, which may have been typed
SHARE = 1e-2  # of the tolerance for the last coefficients of one step: a run takes tens
# most of a state's size in one step, so that SHARE of the tolerance is relative to its start
GROWS = 100.0
LEAST = (
    1e-13  # part of the run below which a step is not halved, if the clock knows it: an input jumps
)
IDLE = 1000  # events in a row that leave the set as it is


def prepare(case: Case, options, tol: float) -> Run:
    """A Run of an LCS; options are EventDriven's. Events: contact (lam_i begins to act) and
    release, contact (0, i)."""
    import scipy.linalg  # noqa: F401  (loaded here, not in the timed run)

    return lambda: LcsIntegrator(case, options, tol).run()


class LcsIntegrator:
    def __init__(self, case, options, tol):
        self.case = case
        self.p = case.problem
        self.options = options
        self.tol = tol
        self.n, self.m = self.p.B.shape
        self.t, self.T, self.x = float(case.t[0]), float(case.t[-1]), case.x0.copy()
        self.inputs = Inputs(self.p)
        self.flows = {}
        self.flow = None
        self.creeps = StallDetector(self.t, self.T - self.t)
        self.least = max(LEAST * (self.T - self.t), 4.0 * np.spacing(max(abs(self.t), abs(self.T))))
        self.total = np.zeros(self.m)
        self.X = np.full((len(case.t), self.n), np.nan)
        self.P = np.full((len(case.t), self.m), np.nan)
        self.X[0] = self.x
        self.P[0] = 0.0
        self.done = 1
        with np.errstate(all="ignore"):
            self.scale, self.top = self._sizes()
        self.events = []
        self.meetings = []
        self.idle = 0
        self.steps = 0
        self.arcs = 0
        self.tried = 0
        self.h = 0.0
        self.asked = 0  # of steps, each of which other integrators take many for
        # sampled: inputs at the samples, by order
        self.pace = None
        self.unsure = False
        self.sampled = {}

    def run(self) -> Trajectory:
        with np.errstate(all="ignore"):
            status = self._choose(START)
            while status.ok and self.t < self.T:
                status = self._arc()
        if status.ok:
            self.X[self.done :], self.P[self.done :] = self.x, self.total
            if self.unsure:
                status = Status(
                    "unverified",
                    f"With more than {ALL} rows that are neither of a P-matrix nor passive it is "
                    "not known whether another motion exists.",
                )
        acted = np.flatnonzero(np.any(self.P > 0.0, axis=0))
        stats = {
            "steps": self.steps,
            "h": float(self.h),
            "events": len(self.events),
            "restarts": self.arcs,
            "inner_iterations": self.tried,
            "loop": "host",
        }
        return Trajectory(
            self.case.t,
            self.X,
            tuple((0, int(i)) for i in acted),
            self.P[:, acted],
            self.P @ self.p.B.T,
            status,
            tuple(self.events),
            stats,
            "mean",
            resolution=Resolution(),
        )

    def _flow(self, rows):
        if rows not in self.flows:
            found = mode(self.p, rows)
            self.flows[rows] = (
                None
                if found is None
                else LinearFlow(found, self.inputs, self.options.method, self.tol)
            )
        return self.flows[rows]

    def _sizes(self):
        """Sizes of the states (n,), above zero, from the start and from what the inputs ask for; of
        the inputs (n + m,)."""
        s = np.abs([self.inputs(t, 0)[0] for t in self.case.t])
        top = np.where(np.isfinite(s), s, 0.0).max(axis=0)
        asked = np.where(
            self.p.C != 0.0,
            top[self.n :, None] / np.abs(np.where(self.p.C != 0.0, self.p.C, 1.0)),
            0.0,
        )
        out = np.maximum(np.abs(self.x), asked.max(axis=0, initial=0.0))
        out = np.maximum(out, np.where(out > 0.0, 0.0, top[: self.n] * (self.T - self.t)))
        return np.where(out > 0.0, out, out.max(initial=0.0) or 1.0), top

    # arcs

    def _arc(self) -> Status:
        """Follow the set of rows to its next event or the end, then choose the next one."""
        flow = self.flow
        self.arcs = self.arcs + 1
        flow.scale = self.scale
        self.x = flow.project(self.t, self.x, self.scale)
        f, size = flow.at(self.t, self.x, (self.scale, self.top))
        armed = f > BAND * size
        grow = np.zeros(self.m)
        span = self.T - float(self.case.t[0])
        h = self.pace or span
        while self.t < self.T:
            h = min(h, span, self.options.max_step)
            if self.steps >= self.options.max_steps:
                return Status("maxiter", f"{self.steps} steps were taken by t = {self.t:.9g}.")
            if self.creeps(self.asked, self.t):
                return Status("maxiter", CREEPS.format(self.t))
            X, s = flow.step(self.t, self.x, h)
            self.steps = self.steps + flow.steps
            self.asked = self.asked + 1
            F = flow.functions(X, s)
            if not (np.all(np.isfinite(X)) and np.all(np.isfinite(F))):
                if h > self.least:
                    h *= 0.25
                    continue
                return self._lost()
            most = np.maximum(self.scale, np.abs(X).max(axis=0))
            more = np.maximum(grow, np.abs(F).max(axis=0))
            terms = np.concatenate((most, np.maximum(size, more)))
            limit = SHARE * self.tol * np.concatenate((most, more)) + NOISE * EPS * terms
            good, easy = resolved(np.hstack([X, F]), limit)
            good = (
                good
                and bool(np.all(most <= GROWS * self.scale))
                and self._seen(flow, s, h, most, more)
            )
            if not good and h > self.least:
                h *= 0.5
                continue
            self.h = max(self.h, h)
            grow = more
            status, fired = self._advance(flow, X, F, h, armed, size)
            if not status.ok or fired:
                self.pace = h
                return self._meet() if status.ok else status
            f, size = flow.at(self.t, self.x, (self.scale, self.top))
            armed |= f > BAND * size
            h = 2.0 * h if easy else h
        self.pace = h
        return Status()

    def _seen(self, flow, s, h, most, more) -> bool:
        """Whether the polynomials of a step are the inputs behind its first node, and at the
        samples that lie in it."""
        inside = slice(*np.searchsorted(self.case.t, (self.t, self.t + h), side="right"))
        order = flow.mode.order
        if order not in self.sampled:
            self.sampled[order] = np.array([self.inputs(t, order) for t in self.case.t])
        x, f = flow.missed(self.t, s, h, (self.case.t[inside], self.sampled[order][inside]))
        return bool(np.all(x <= self.tol * most) and np.all(f <= self.tol * more))

    def _lost(self):
        if np.abs(self.x).max() > 1e150:
            return Status("diverged", f"The state passed 1e150 at t = {self.t:.9g}.")
        return Status(
            "nan", f"The inputs u and q, or the state, are not finite after t = {self.t:.9g}."
        )

    def _advance(self, flow, X, F, h, armed, size):
        """Record samples up to the first event on the step, or to its end; (status, did something
        fire)."""
        level = np.where(armed, 0.0, -BAND * size)
        found = crossing(F, level)
        reach = 1.0 if found is None else found[0]
        end = self.t + 0.5 * h * (1.0 + reach)
        cut = end > self.T or (found is None and abs(end - self.T) <= 4.0 * np.spacing(abs(self.T)))
        if cut:
            end = self.T
            found = None
        P = self.total + h * (SUM @ _lam(F, flow.mode.rows))
        while self.done < len(self.case.t) and self.case.t[self.done] <= end:
            at = 2.0 * (self.case.t[self.done] - self.t) / h - 1.0
            self.X[self.done], self.P[self.done] = value(X, at), value(P, at)
            self.done += 1
        at = 2.0 * (end - self.t) / h - 1.0
        if at >= 1.0:
            self.x, self.total = X[-1].copy(), P[-1].copy()
        else:
            self.x, self.total = value(X, at), value(P, at)
        self.t = end
        self.scale = np.maximum(
            self.scale, np.abs(np.vstack([X[S <= at], self.x])).max(axis=0)
        )  # no size beyond an event
        if not np.all(np.isfinite(self.x)):
            return self._lost(), False
        return Status(), found is not None

    def _meet(self) -> Status:
        self.meetings.append(self.t)
        ends = accumulation(self.meetings, self.T - float(self.case.t[0]))
        if ends is not None:
            return Status(
                "chatter",
                f"Events accumulate at t = {ends:.9g}: following events cannot pass that time.",
            )
        if len(self.meetings) > self.options.max_events:
            return Status(
                "chatter",
                f"{len(self.meetings)} events were met by t = {self.t:.9g}; raise max_events.",
            )
        old = set(self.flow.mode.rows)
        status = self._choose(BAND)
        if not status.ok:
            return status
        new = set(self.flow.mode.rows)
        self.events += [Event(self.t, "contact", (0, int(i))) for i in sorted(new - old)]
        self.events += [Event(self.t, "release", (0, int(i))) for i in sorted(old - new)]
        self.idle = self.idle + 1 if old == new else 0
        if self.idle > IDLE:
            return Status(
                "chatter",
                f"{IDLE} events up to t = {self.t:.9g} changed nothing: lam or w stays within "
                f"rounding "
                "of zero.",
            )
        return Status()

    # the choice of rows

    def _choose(self, band) -> Status:
        flows = [f for f in (self._flow(rows) for rows in self._candidates()) if f is not None]
        self.tried += len(flows)
        flows = [f for f in flows if self._starts(f, band)]
        span = self.T - float(self.case.t[0])
        fast = min([span, *(1.0 / f.fastest for f in flows if f.fastest > 0.0)])
        times = fast * 10.0 ** np.arange(FIRST, 1.0 + np.log10(LONGEST * span / fast))
        good = [
            (left, len(f.mode.rows), f.mode.rows, f)
            for f in flows
            if (left := self._undecided(f, band, times)) is not None
        ]
        if not good:
            return Status(
                "infeasible",
                f"At t = {self.t:.9g} no lambda continues the motion without a jump of the state.",
            )
        first, *others = (g[-1] for g in sorted(good, key=lambda g: g[:3]))
        for other in others:
            if self._apart(first, other, times):
                return Status(
                    "degenerate",
                    f"At t = {self.t:.9g} several motions continue (rows {list(first.mode.rows)} "
                    f"or "
                    f"{list(other.mode.rows)} act): the solution is not unique there.",
                )
        self.flow = first
        return Status()

    def _candidates(self):
        """Sets of rows to look at: all of them, or what implicit steps of decreasing length choose,
        and their like."""
        if self.m <= ALL:
            return [tuple(i for i in range(self.m) if (code >> i) & 1) for code in range(2**self.m)]
        from nsbench.lcp import lemke

        out = [] if self.flow is None else [self.flow.mode.rows]
        span = self.T - float(self.case.t[0])
        for h in span * 10.0 ** -np.arange(3.0, 9.0):
            W = np.linalg.inv(np.eye(self.n) - h * self.p.A)
            s = self.inputs(self.t + h, 0)[0]
            z = W @ (self.x + h * s[: self.n])
            G = h * W @ self.p.B
            M = self.p.D + self.p.C @ G
            r = self.p.C @ z + s[self.n :]
            a, b = lemke.scales(M)
            on = np.zeros(self.m, np.bool_)
            lam = np.zeros(self.m)
            if lemke.solve(M, r, a, b, on, lam, np.zeros(self.m))[0]:
                out.append(tuple(int(i) for i in np.flatnonzero(lam > 0.0)))
            if not self.unsure and not certainly_unique(M, G):
                self.unsure = True
        return list(dict.fromkeys(out))

    def _starts(self, flow, band) -> bool:
        """Does the state satisfy the constraints of this set, with lam and w not negative now?"""
        off, size = flow.off(self.t, self.x, (self.scale, self.top))
        if np.any(np.abs(off) > band * size):
            return False
        x = flow.project(self.t, self.x, self.scale)
        f, size = flow.at(self.t, x, (self.scale, self.top))
        return bool(np.all(f >= -band * size))  # False where not finite

    def _undecided(self, flow, band, times) -> int | None:
        """How many of lam and w vanish on the trial motions too; None if one turns negative
        first."""
        x = flow.project(self.t, self.x, self.scale)
        f, size = flow.at(self.t, x, (self.scale, self.top))
        signs = np.where(f > band * size, 1, 0)
        for h in times:
            if np.all(signs > 0):
                break
            f, clear, _ = self._after(flow, x, h)
            if not np.all(np.isfinite(f)):
                return None
            signs = np.where((signs == 0) & clear, np.sign(f), signs)
            if np.any(signs < 0):
                return None
            if np.any(clear & (f < 0.0)):  # one that was positive: from here another set acts
                break
        return int(np.count_nonzero(signs == 0))

    def _after(self, flow, x, h):
        """lam and w after the time h in this set, which of them are beyond rounding, and the
        state."""
        X, _ = flow.collocate(self.t, x, h)
        f, size = flow.at(self.t + h, X[-1], (np.maximum(self.scale, np.abs(X[-1])), self.top))
        return f, np.abs(f) > BAND * size, X[-1]

    def _apart(self, a, b, times) -> bool:
        """Do the motions of two sets differ, as long as both are motions?"""
        xa, xb = (f.project(self.t, self.x, self.scale) for f in (a, b))
        for h in times:
            fa, clear_a, ya = self._after(a, xa, h)
            fb, clear_b, yb = self._after(b, xb, h)
            if np.any(clear_a & (fa < 0.0)) or np.any(clear_b & (fb < 0.0)):
                return False
            if np.any(np.abs(ya - yb) > BAND * self.scale):
                return True
        return False


def _lam(F, rows):
    """lam at the nodes: the functions of the rows, zero elsewhere."""
    out = np.zeros_like(F)
    out[:, list(rows)] = F[:, list(rows)]
    return out
