"""The event-driven method on Complementarity systems: smooth arcs with a fixed set of active
contacts.

On an arc  x' = f + G_W^T lam,  (G_W G_W^T) lam = -(G_W f + dg_W/dt),  for a basis W of the closed
contacts; impulses and reaction are further states, and after every step x is put back on g_W = 0
(index reduction drifts). An arc ends where a gap closes or a multiplier vanishes; then _selection
chooses the next basis. Closed contacts that depend on W carry nothing: their gaps are watched for
true violation, not for rounding.
"""

from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.solvers.base import Run
from nsbench.solvers.common.initial_state import initial_state
from nsbench.solvers.event_driven.contacts import compiled_loop
from nsbench.solvers.event_driven.contacts.active_set import ActiveSetSelector
from nsbench.solvers.event_driven.contacts.evaluation import ContactField
from nsbench.solvers.event_driven.smooth.arc import integrate_to_event
from nsbench.trajectory import Event, Resolution, Status, Trajectory

MEMORY = 10  # arcs whose largest step is the time scale of the look-ahead
# events, and twice the contacts held, that may fall together before they count as accumulation
CROWD = 100
TOGETHER = 1e-10  # part of the run that counts as one instant


def prepare(case: Case, options, tol: float) -> Run:
    """A Run; options has method, max_step, max_steps and max_events. ValueError for an infeasible
    start."""
    import scipy.integrate  # noqa: F401  (loaded here, not in the timed run)

    scene = ConstraintSet(case.problem, case.n)
    x = initial_state(case, scene)
    field = ContactField(case, scene)
    plan = compiled_loop.plan(case, field, x, options, tol)
    field.compile(float(case.t[0]), x, arcs=plan is None)
    if plan is not None:
        compiled_loop.load(ContactIntegrator(case, scene, x.copy(), options, tol), plan)

    def run():
        if plan is not None:
            walk = ContactIntegrator(case, scene, x.copy(), options, tol)
            if compiled_loop.run(walk, plan):
                return walk._trajectory(Status())
        return ContactIntegrator(case, scene, x.copy(), options, tol).run()

    return run


class ContactIntegrator:
    """One run: where it is, what is held, what was recorded."""

    def __init__(self, case, scene, x, options, tol):
        self.case = case
        self.options = options
        self.tol = tol
        self.field = ContactField(case, scene)
        self.selector = ActiveSetSelector(self.field)
        self.t, self.x, self.T = float(case.t[0]), x, float(case.t[-1])
        self.all = self.field.candidates(self.t, x)
        self.basis = np.empty(0, np.int64)
        self.kept = np.zeros(len(self.all), bool)
        self.column = {}
        self.total = np.empty(0)
        self.reaction = np.zeros(case.n)
        self.X = np.full((len(case.t), case.n), np.nan)
        self.R = np.full((len(case.t), case.n), np.nan)
        self.impulses = []
        self.done = 0
        self.events = []
        self.meetings = []
        self.paces = []
        self.proof = {"unproven": 0, "refused": 0, "touches": 0}
        self.loop = "host"
        self.steps = 0
        self.arcs = 0
        self.h = 0.0
        self.peak = 0
        self.lam = np.empty(0)

    def run(self) -> Trajectory:
        with np.errstate(all="ignore"):
            self._record(self.x[None], np.zeros((1, 0)), np.zeros((1, self.case.n)))
            status = self._start()
            while status.ok and self.t < self.T:
                status = self._arc()
        return self._trajectory(status)

    def _start(self) -> Status:
        f = self.field.drift(self.t, self.x)
        if not np.all(np.isfinite(f)):
            return Status("nan", f"The drift is not finite at t = {self.t:.9g}.")
        pace = (self.field.unit + np.abs(self.x).max()) / np.abs(f).max() if np.any(f) else np.inf
        self.paces.append(min(1e-2 * pace, 1e-2 * (self.T - self.t), np.diff(self.case.t).min()))
        return self._select(first=True)

    def _band(self, rows):
        """(m,) gaps this small count as closed, and closed gaps are watched for this much
        violation."""
        return self.tol * (self.field.unit + np.abs(self.x).max()) * rows.norm

    def _select(self, first=False, fired=None) -> Status:
        """List the candidates here, choose the basis, write down what changed. fired: the contact
        that just closed."""
        before = (
            {}
            if first
            else dict(
                zip(
                    self.field.take(self.all, self.kept).near.ids,
                    np.isin(np.flatnonzero(self.kept), self.basis),
                    strict=True,
                )
            )
        )
        ids = self.field.take(self.all, self.basis).near.ids
        self._relist()
        g = self.field.gaps(self.t, self.x, self.all)
        if not np.all(np.isfinite(g)):
            return Status(
                "nan",
                f"Constraint {self.all.near.ids[int(np.argmin(np.isfinite(g)))]} is not finite "
                f"at t = {self.t:.9g}.",
            )
        touching = g <= self._band(self.all)
        if (
            fired is not None
        ):  # closed to the last digit of the time, whatever its speed makes of that
            touching[self.all.near.ids.index(fired)] = True
        closed = np.flatnonzero(touching)
        rows = self.field.take(self.all, closed)
        names = rows.near.ids
        place = {c: k for k, c in enumerate(names)}
        choice = self.selector.choose(
            self.t, self.x, rows, [place[c] for c in ids if c in place], max(self.paces[-MEMORY:])
        )
        if choice.stuck >= 0:
            return self._no_way(names[choice.stuck], choice.flat)
        self.basis = closed[np.sort(choice.basis)]
        self.kept = np.zeros(len(self.all), bool)
        self.kept[closed[choice.kept]] = True
        after = {names[k]: k in choice.basis for k in np.flatnonzero(choice.kept)}
        if not first:
            self._note(before, after)
        self.peak = max(self.peak, len(after))
        y = self.field.project(self.t, self.x, self.field.take(self.all, self.basis))
        self.x = self.x if y is None else y
        return Status()

    def _note(self, before, after):
        """Events: what closed, what opened, what stays closed but handed its load to others."""
        for kind, ids in (
            ("contact", [c for c in after if c not in before]),
            ("release", [c for c in before if c not in after]),
            ("pivot", [c for c in after if before.get(c, False) and not after[c]]),
        ):
            self.events += [Event(self.t, kind, c) for c in ids]

    def _no_way(self, contact, flat) -> Status:
        if flat:
            return Status(
                "degenerate",
                f"Constraint {contact}: the gradient is zero or undefined at t = {self.t:.9g}, "
                "where it is active: no direction leads away from it.",
            )
        return Status(
            "infeasible",
            f"No velocity keeps constraint {contact} and those it depends on, at "
            f"t = {self.t:.9g}: the constraints leave no way on.",
        )

    def _relist(self):
        """Candidates around the present state; basis and kept contacts keep their meaning."""
        if self.field.certified:
            new = self.field.candidates(self.t, self.x)
            key = new.near.key
            order = np.argsort(key)
            move = lambda index: order[np.searchsorted(key, self.all.near.key[index], sorter=order)]
            basis = move(self.basis)
            kept = np.zeros(len(new), bool)
            kept[move(self.kept)] = True
            self.all = new
            self.basis = basis
            self.kept = kept
        self.anchor = self.x

    def _arc(self) -> Status:
        """Follow the basis to its next event or the end, then choose the next basis."""
        n = self.case.n
        p = len(self.basis)
        held = self.field.take(self.all, self.basis)
        others = self.field.take(self.all, np.delete(np.arange(len(self.all)), self.basis))
        field = self.field
        anchor = self.anchor
        o = len(others)

        def rhs(t, y):
            return np.concatenate(field.held(t, y[:n], held))

        def gaps(t, y):
            lam = field.held(t, y[:n], held)[1] if p else ()
            return np.concatenate(
                (field.gaps(t, y[:n], others), lam, field.travelled(y[:n], anchor))
            )

        def project(t, y):
            x = field.project(t, y[:n], held)
            return None if x is None else np.concatenate((x, y[n:]))

        still = len(gaps(self.t, np.concatenate((self.x, np.zeros(p + n))))) - o - p
        band = np.concatenate(
            (self._band(others), self.tol * self.selector.size / held.norm, np.zeros(still))
        )
        arc = integrate_to_event(
            rhs,
            self.t,
            np.concatenate((self.x, np.zeros(p + n))),
            self.T,
            gaps if band.size else None,
            method=self.options.method,
            rtol=self.tol,
            atol=self.tol * field.unit,
            band=band,
            project=project if p else None,
            samples=self.case.t[self.done :],
            max_step=self.options.max_step,
            max_steps=self.options.max_steps - self.steps,
            data=lambda t, y: field.data(t, y[:n]),
        )
        return self._after(arc, held, o, p)

    def _after(self, arc, held, o, p) -> Status:
        n = self.case.n
        self.arcs += 1
        self.steps += arc.steps
        for name in self.proof:
            self.proof[name] += getattr(arc, name)
        self.h = max(self.h, arc.h)
        if arc.h > 0.0:
            self.paces.append(arc.h)
        where = [self.column.setdefault(c, len(self.column)) for c in held.near.ids]
        self.total = np.append(self.total, np.zeros(len(self.column) - len(self.total)))
        increments = np.zeros((len(arc.samples), len(self.column)))
        increments[:, where] = arc.samples[:, n : n + p]
        self._record(arc.samples[:, :n], increments, arc.samples[:, n + p :])
        self.total[where] += arc.y[n : n + p]
        self.reaction = self.reaction + arc.y[n + p :]
        self.t, self.x = float(arc.t), arc.y[:n].copy()
        if not arc.status.ok:
            return self._why(arc.status, held)
        if not arc.fired.size:
            return Status()
        if arc.fired[0] >= o + p:
            self._relist()
            return Status()
        self.meetings.append(self.t)
        opens = np.delete(np.arange(len(self.all)), self.basis)
        fired = (
            self.field.take(self.all, opens[arc.fired[:1]]).near.ids[0]
            if arc.fired[0] < o
            else None
        )
        return self._budget() or self._select(fired=fired)

    def _budget(self) -> Status | None:
        crowd = CROWD + 2 * self.peak
        if len(self.meetings) > self.options.max_events:
            return Status(
                "chatter", f"{self.options.max_events} events happened by t = {self.t:.9g}."
            )
        span = TOGETHER * (self.T - float(self.case.t[0]))
        if len(self.meetings) > crowd and self.t - self.meetings[-crowd] < span:
            return Status(
                "chatter",
                f"Events accumulate at t = {self.t:.9g}: {crowd} of them within {span:.1g}.",
            )
        return None

    def _why(self, status, held) -> Status:
        """A stepper that stops while multipliers explode has met contacts that lock."""
        if status.code == "maxiter" and self.steps >= self.options.max_steps:
            return Status(
                "maxiter", f"{self.options.max_steps} steps were taken by t = {self.t:.9g}."
            )
        if status.code in ("degenerate", "diverged") and len(held):
            lam = self.field.held(self.t, self.x, held)[1] * held.norm
            if not np.all(np.abs(lam) < 1e6 * self.selector.size):
                k = int(np.argmax(np.where(np.isfinite(lam), np.abs(lam), np.inf)))
                return Status(
                    "infeasible",
                    f"Contacts lock at t = {self.t:.9g}: the multiplier of {held.near.ids[k]} "
                    "grows without bound.",
                )
        return status

    def _record(self, x, impulse, reaction):
        for row in range(len(x)):
            self.X[self.done], self.R[self.done] = x[row], self.reaction + reaction[row]
            self.impulses.append(self.total + impulse[row])
            self.done += 1

    def _trajectory(self, status) -> Trajectory:
        impulse = np.full((len(self.case.t), len(self.column)), np.nan)
        for k, row in enumerate(self.impulses):
            impulse[k] = np.append(row, np.zeros(len(self.column) - len(row)))
        if status.ok and (self.done < len(self.case.t) or not np.all(np.isfinite(self.X))):
            status = Status("unverified", "Samples are missing although no failure was met.")
        stats = {
            "steps": self.steps,
            "h": float(self.h),
            "drift_calls": self.field.calls,
            "qp_solves": self.selector.solved,
            "inner_iterations": self.selector.iterations,
            "events": len(self.events),
            "restarts": self.arcs,
            "contacts_peak": self.peak,
            "loop": self.loop,
            "roots": "sampled" if self.proof["unproven"] else "verified",
            **self.proof,
        }
        return Trajectory(
            self.case.t,
            self.X,
            tuple(self.column),
            impulse,
            self.R,
            status,
            tuple(self.events),
            stats,
            "mean",
            resolution=Resolution(),
        )
