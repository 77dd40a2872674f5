"""Integrate a Complementarity system between events in Python: smooth arcs with active contacts.

On an arc  x' = f + G_A^T lam,  (G_A G_A^T) lam = -(G_A f + dg_A/dt),  for independent active
contacts A among the closed ones. Impulses and reaction are further states, and after every step x
is projected onto g_A = 0 (index reduction drifts). An arc ends where a gap closes or a multiplier
vanishes; then active_set chooses the next active contacts. Closed contacts that depend on A have no
multiplier: their gaps are watched for true violation, not for rounding.
"""

from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.case.scale import span_text, time_text
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.solvers.event_driven.accumulation import crowded_events
from nsbench.solvers.event_driven.contacts import compiled_loop
from nsbench.solvers.event_driven.contacts.active_set import (
    ActiveSetSelector,
    affected_by_event,
    mask_of,
)
from nsbench.solvers.event_driven.contacts.evaluation import ContactField, ContactRows
from nsbench.solvers.event_driven.contacts.failure_status import (
    describe_infeasible,
    describe_locking,
)
from nsbench.solvers.event_driven.contacts.kinked_drift import KinkedDrift
from nsbench.solvers.event_driven.slow_path import HostNotes, describe_slow_path, points
from nsbench.solvers.event_driven.smooth.arc import Arc, integrate_to_event
from nsbench.trajectory import Event, Resolution, Status, Trajectory

RECENT_ARCS = 10  # arcs whose largest step is the time scale of the look-ahead


class ContactIntegrator:
    """State, active contacts and recorded results of one run.

    The compiled loop reads and writes t, x (state), candidates (every contact that can become
    active soon), active (entries of them, ascending), closed (mask of them), list_centre (the state
    at which they were listed), recent_steps (largest steps of the last arcs), event_times and
    max_closed (most contacts closed at once); it calls the methods without underscore.
    """

    def __init__(
        self,
        case: Case,
        constraints: ConstraintSet,
        x: np.ndarray,
        options,
        tol: float,
        kinks: KinkedDrift | None,
        notes: HostNotes,
    ):
        self.case = case
        self.options = options
        self.tol = tol
        self.kinks = kinks  # None: the drift has none, or it cannot be traced
        self._notes = notes
        self.field = ContactField(case, constraints, kinks)
        self.selector = ActiveSetSelector(self.field)
        self.t = float(case.t[0])
        self.end = float(case.t[-1])
        self.x = x
        self.candidates = self.field.candidates(self.t, x)
        self.active = np.empty(0, np.int64)
        self.closed = np.zeros(len(self.candidates), bool)
        self.list_centre = x
        self.recent_steps = []
        self.event_times = []
        self.max_closed = 0
        self.events = []
        self.columns = {}  # id of a contact that ever acted: its column of the impulses
        self._total = np.empty(0)
        self._reaction = np.zeros(case.n)
        self._states = np.full((len(case.t), case.n), np.nan)
        self._reactions = np.full((len(case.t), case.n), np.nan)
        self._impulses = []
        self._recorded = 0
        self._proof = {"unproven": 0, "refused": 0, "touches": 0}
        self._loop = "host"
        self._steps = 0
        self._arcs = 0
        self._longest_step = 0.0
        if kinks is not None:
            kinks.begin(self.t, x)

    now = property(lambda self: time_text(self.t))  # the present time in words

    def run(self) -> Trajectory:
        """Integrate from the start to the end, or to the first failure."""
        with np.errstate(all="ignore"):
            self._record(self.x[None], np.zeros((1, 0)), np.zeros((1, self.case.n)))
            status = self.start()
            # Event-driven integration: one arc with fixed active contacts after the other.
            while status.ok and self.t < self.end:
                status = self._follow_arc()
            if status.ok and self._recorded < len(self.case.t):  # an event at the very end
                none = np.zeros((1, len(self._total)))
                self._record(self.x[None], none, np.zeros((1, self.case.n)))
        return self.trajectory(status)

    def start(self) -> Status:
        """Choose the first active contacts and the first time scale."""
        f = self.field.drift(self.t, self.x)
        if not np.all(np.isfinite(f)):
            return Status("nan", f"The drift is not finite at t = {self.now}.")
        size = self.field.length + np.abs(self.x).max()
        fastest = size / np.abs(f).max() if np.any(f) else np.inf
        self.recent_steps.append(
            min(1e-2 * fastest, 1e-2 * (self.end - self.t), np.diff(self.case.t).min())
        )
        return self._choose_and_project(first=True)

    def choose_active_set(
        self,
        closing: int = -1,
        changed: int = -1,
        labels: np.ndarray | None = None,
        first: bool = False,
    ) -> Status:
        """Choose the active among the closed contacts; log what changed unless it is the first
        time.

        closing: entry that just closed, or -1. changed: that, or the entry whose multiplier
        vanished. labels (n,): part of each coordinate that the drift couples; contacts in parts
        without a change then keep their state. None: all closed contacts are chosen together.
        """
        rows = self.candidates
        g = self.field.gaps(self.t, self.x, rows)
        if not np.all(np.isfinite(g)):
            contact = rows.listed.ids[int(np.argmin(np.isfinite(g)))]
            return Status("nan", f"Constraint {contact} is not finite at t = {self.now}.")
        touching = g <= self._band(rows)
        if closing >= 0:  # closed to the last digit of the time, however fast its gap changes
            touching[closing] = True
        was_active = mask_of(len(rows), self.active)
        affected = np.ones(len(rows), bool)
        if labels is not None:
            differs = touching != self.closed
            differs[changed] = True
            affected = affected_by_event(
                self.field, self.t, self.x, rows, labels, touching | self.closed, differs
            )
        index = np.flatnonzero(touching & affected)
        choice = self.selector.choose(
            self.t,
            self.x,
            self.field.take(rows, index),
            np.flatnonzero(was_active[index]),
            max(self.recent_steps[-RECENT_ARCS:]),
        )
        if choice.stuck >= 0:
            contact = rows.listed.ids[index[choice.stuck]]
            return describe_infeasible(contact, choice.flat, self.now)
        closed = np.where(affected, False, self.closed)
        active = np.where(affected, False, was_active)
        closed[index[choice.closed]] = True
        active[index[choice.active]] = True
        if not first:
            self._record_events(was_active, active, closed)
        self.active = np.flatnonzero(active)
        self.closed = closed
        self.max_closed = max(self.max_closed, int(closed.sum()))
        return Status()

    def _choose_and_project(self, closing=-1, first=False) -> Status:
        """Choose the active contacts among new candidates and project x onto them."""
        closing = self.rebuild_candidates(closing)
        status = self.choose_active_set(closing, first=first)
        if not status.ok:
            return status
        y = self.field.project(self.t, self.x, self.field.take(self.candidates, self.active))
        self.x = self.x if y is None else y
        return Status()

    def _record_events(self, was_active, active, closed):
        """Log which contacts closed, which opened, and which lost their multiplier to others."""
        changes = (
            ("contact", closed & ~self.closed),
            ("release", self.closed & ~closed),
            ("pivot", closed & was_active & ~active),
        )
        for kind, mask in changes:
            ids = self.candidates.listed.take(np.flatnonzero(mask)).ids
            self.events += [Event(self.t, kind, c) for c in ids]

    def rebuild_candidates(self, entry: int = -1) -> int:
        """List the candidates around the present state; return the new index of an entry, or -1."""
        if self.field.certified:
            new = self.field.candidates(self.t, self.x)
            key = new.listed.key
            order = np.argsort(key)
            old_key = self.candidates.listed.key
            move = lambda index: order[np.searchsorted(key, old_key[index], sorter=order)]
            active = move(self.active)
            closed = np.zeros(len(new), bool)
            closed[move(self.closed)] = True
            entry = int(move(entry)) if entry >= 0 else -1
            self.candidates = new
            self.active = active
            self.closed = closed
        self.list_centre = self.x
        return entry

    def check_event_limits(self) -> Status | None:
        """Return a status if the run has too many events, in all or at one instant, else None."""
        if len(self.event_times) > self.options.max_events:
            return Status(
                "chatter", f"{self.options.max_events} events happened by t = {self.now}."
            )
        crowd = crowded_events(self.event_times, self.t, self.case.own_time, self.max_closed)
        if crowd is not None:
            many = f"{crowd[0]} within {span_text(crowd[1], 1)}"
            return Status("chatter", f"Events accumulate at t = {self.now}: {many}.")
        return None

    def _band(self, rows: ContactRows):
        """Return the gaps (m,) up to which contacts count as closed, and below zero as violated."""
        return self.tol * (self.field.length + np.abs(self.x).max()) * rows.norm

    def _follow_arc(self) -> Status:
        """Integrate with the active contacts to the next event or the end; choose the next ones."""
        n = self.case.n
        p = len(self.active)
        field = self.field
        held = field.take(self.candidates, self.active)
        others = field.take(
            self.candidates, np.delete(np.arange(len(self.candidates)), self.active)
        )
        list_centre = self.list_centre
        kinks = self.kinks
        if kinks is not None:
            status = kinks.settle(
                self.t, self.x, lambda t, x: field.constrained_velocity(t, x, held)[0]
            )
            if not status.ok:
                return status

        def rhs(t: float, y: np.ndarray) -> np.ndarray:
            return np.concatenate(field.constrained_velocity(t, y[:n], held))

        # Event functions: gaps of the others, multipliers, displacement of certified candidates,
        # kinks of the drift.
        def event_functions(t: float, y: np.ndarray) -> np.ndarray:
            lam = field.constrained_velocity(t, y[:n], held)[1] if p else ()
            margin = field.displacement_margin(y[:n], list_centre)
            kinked = () if kinks is None else kinks.distances(t, y[:n])
            return np.concatenate((field.gaps(t, y[:n], others), lam, margin, kinked))

        def project(t: float, y: np.ndarray) -> np.ndarray | None:
            x = field.project(t, y[:n], held)
            return None if x is None else np.concatenate((x, y[n:]))

        y0 = np.concatenate((self.x, np.zeros(p + n)))
        kink_band = np.empty(0) if kinks is None else kinks.bands(self.t, self.x)
        margins = len(event_functions(self.t, y0)) - len(others) - p - len(kink_band)
        multiplier_band = self.tol * self.selector.drift_size / held.norm
        band = np.concatenate((self._band(others), multiplier_band, np.zeros(margins), kink_band))
        arc = integrate_to_event(
            rhs,
            self.t,
            y0,
            self.end,
            event_functions if band.size else None,
            method=self.options.method,
            rtol=self.tol,
            atol=self.tol * field.length,
            band=band,
            project=project if p else None,
            samples=self.case.t[self._recorded :],
            max_step=self.options.max_step,
            max_steps=self.options.max_steps - self._steps,
            data=lambda t, y: field.enclose(t, y[:n]),
        )
        self._record_arc(arc, held)
        if arc.status.ok and np.any(arc.fired >= len(others) + p + margins):
            return self._cross_kink(int(arc.fired[0]) - len(others) - p - margins)
        return self._end_arc(arc, held, len(others))

    def _cross_kink(self, watched: int) -> Status:
        """Change the state of a kink; choose the active contacts again if the drift jumps."""
        jumps = self.kinks.cross(watched, self.t, self.x)
        return self._choose_and_project() if jumps else Status()

    def _record_arc(self, arc: Arc, held: ContactRows):
        """Move the state to the end of the arc; record its samples, impulses and counts."""
        n = self.case.n
        p = len(held)
        self._arcs += 1
        self._steps += arc.steps
        for name in self._proof:
            self._proof[name] += getattr(arc, name)
        self._longest_step = max(self._longest_step, arc.h)
        if arc.h > 0.0:
            self.recent_steps.append(arc.h)
        column = [self.columns.setdefault(c, len(self.columns)) for c in held.listed.ids]
        self._total = np.append(self._total, np.zeros(len(self.columns) - len(self._total)))
        increments = np.zeros((len(arc.samples), len(self.columns)))
        increments[:, column] = arc.samples[:, n : n + p]
        self._record(arc.samples[:, :n], increments, arc.samples[:, n + p :])
        self._total[column] += arc.y[n : n + p]
        self._reaction = self._reaction + arc.y[n + p :]
        self.t = float(arc.t)
        self.x = arc.y[:n].copy()

    def _end_arc(self, arc: Arc, held: ContactRows, others: int) -> Status:
        """React to the event that ended an arc; others: gaps among its event functions."""
        if not arc.status.ok:
            return self._describe_failure(arc.status, held)
        if not arc.fired.size:
            return Status()
        fired = int(arc.fired[0])
        if fired >= others + len(held):
            self.rebuild_candidates()
            return Status()
        self.event_times.append(self.t)
        closing = -1
        if fired < others:
            closing = int(np.delete(np.arange(len(self.candidates)), self.active)[fired])
        return self.check_event_limits() or self._choose_and_project(closing)

    def _describe_failure(self, status, held) -> Status:
        """Describe a stopped arc: a stepper that stops while multipliers explode met a lock."""
        if status.code == "maxiter" and self._steps >= self.options.max_steps:
            return Status(
                "maxiter", f"{self.options.max_steps} steps were taken by t = {self.now}."
            )
        if status.code in ("degenerate", "diverged") and len(held):
            lam = self.field.constrained_velocity(self.t, self.x, held)[1] * held.norm
            ids = held.listed.ids
            return describe_locking(lam, self.selector.drift_size, ids, self.now) or status
        return status

    def _record(self, x, impulse, reaction):
        """Record samples of the state, and of impulse and reaction since the start of the arc."""
        for row in range(len(x)):
            self._states[self._recorded] = x[row]
            self._reactions[self._recorded] = self._reaction + reaction[row]
            self._impulses.append(self._total + impulse[row])
            self._recorded += 1

    def adopt_compiled_run(self, run: compiled_loop.CompiledRun):
        """Take over samples and counts of a finished compiled run."""
        self._states = run.samples.state
        self._reactions = run.samples.reaction
        self._recorded = int(run.counters.sample[0])
        self._impulses = list(run.samples.impulse[:, : len(self.columns)])
        self._steps = int(run.counters.steps[0])
        self._arcs = int(run.counters.arcs[0]) + 1
        self._longest_step = run.longest_step
        self._proof["touches"] = int(run.counters.touches[0])
        self.field.calls += int(run.counters.orders[0])
        self.selector.solved += int(run.counters.active_sets[0])
        self._loop = "compiled"

    def trajectory(self, status: Status) -> Trajectory:
        """Return what was recorded as a trajectory."""
        impulse = np.full((len(self.case.t), len(self.columns)), np.nan)
        impulse[: len(self._impulses)] = 0.0
        for k, row in enumerate(self._impulses):
            impulse[k, : len(row)] = row
        complete = self._recorded == len(self.case.t) and np.all(np.isfinite(self._states))
        if status.ok and not complete:
            status = Status("unverified", "Samples are missing although no failure was met.")
        stats = {
            "steps": self._steps,
            "h": float(self._longest_step),
            "drift_calls": self.field.calls,
            "qp_solves": self.selector.solved,
            "inner_iterations": self.selector.iterations,
            "events": len(self.events),
            "restarts": self._arcs,
            "contacts_peak": self.max_closed,
            "loop": self._loop,
            "roots": "sampled" if self._proof["unproven"] else "verified",
            **self._proof,
            **describe_slow_path(
                self._notes.reason if self._loop == "host" else "",
                [],
                self._proof["unproven"],
                lambda: self.field.enclose(*points(self.t, self.x)),
                self._notes.untraced,
            ),
        }
        return Trajectory(
            self.case.t,
            self._states,
            tuple(self.columns),
            impulse,
            self._reactions,
            status,
            tuple(self.events),
            stats,
            "mean",
            resolution=Resolution(),
        )
