"""Event-driven method on Filippov systems: smooth arcs in one mode, joined where the mode changes.

At an event the next mode is chosen by event_driven.filippov.mode_search. Where both sides of a
surface have the same field nothing happens on it: a motion that stays on it goes on in the mode
FREE. Where a case can be traced, compiled Taylor steps follow the motion and come here only for
what they cannot decide (event_driven.filippov.compiled_loop).
"""

from __future__ import annotations

from functools import cached_property
from itertools import product

import numpy as np

from nsbench.case import Case
from nsbench.case.scale import time_text
from nsbench.dynamics.filippov.vector_field import EPS, FREE, FilippovVectorField
from nsbench.solvers.base import Run
from nsbench.solvers.event_driven.accumulation import accumulation
from nsbench.solvers.event_driven.filippov.compiled_loop import CompiledLoop
from nsbench.solvers.event_driven.filippov.interval_fields import interval_fields
from nsbench.solvers.event_driven.filippov.mode_search import (
    FLAT,
    ModeSearch,
    jump_time,
    rounding_band,
    surface_names,
)
from nsbench.solvers.event_driven.filippov.program import UntraceableError, trace_programs
from nsbench.solvers.event_driven.slow_path import describe_slow_path, points
from nsbench.solvers.event_driven.smooth.arc import UNPROVEN_PARTS, integrate_to_event
from nsbench.trajectory import Event, Resolution, Status, Trajectory

AWAY = 1e-9  # relative distance at which a surface is left that does not hold the motion
# roundings of c_i below which an event function is not armed at the start of an arc
ARC_BAND = 16.0
TOUCH = 100.0  # tolerances of the arcs: less weight than this cannot be told from a touch
IDLE = 1000  # events in a row that leave the mode as it is before the run is called stuck
EVENT_DRIVEN = Resolution()  # no step, no layer: events are located
LOST_WEIGHT = 1e3  # bound on event functions of weights: beyond, they are infinite


def prepare(case: Case, options, tol: float) -> Run:
    """Prepare a run of a Filippov case; options: EventDriven's, tol: the tolerance of the arcs.

    Its trajectory has the integrals of theta; events enter, exit and cross have contact (0, i).
    """
    field = FilippovVectorField(case.problem, float(case.t[0]), case.x0)
    compiled = None
    reason = "" if options.compiled else "compiled=false is set"
    if options.method != "dop853":
        reason = f"method={options.method} is set, and the compiled loop has its own integrator"
    if not reason:
        try:
            times = float(case.t[0]), float(case.t[-1])
            programs = trace_programs(case.problem, field.d, times, case.x0)
            compiled = CompiledLoop(programs, case, options, tol)
        except UntraceableError as e:
            reason = str(e)
    return lambda: FilippovIntegrator(case, field, options, tol, compiled, reason).run()


class Arc:
    """Equations of an arc in one mode: y = (x, theta), theta the integrals of the weights."""

    def __init__(self, field: FilippovVectorField, mode: np.ndarray, signs: np.ndarray, t, x):
        self.field = field
        self.mode = mode
        self.signs = signs.copy()  # the last ones found, from which the next are computed
        self.n = x.size
        self.sliding = np.flatnonzero(mode == 0)
        self.free = np.flatnonzero(mode == FREE)
        self.away = AWAY / EPS * rounding_band(field, t, x, 1.0)[self.free]

    def derivative(self, t: float, y: np.ndarray) -> np.ndarray:
        """Return y' = (F, (1 + s) / 2)."""
        F, s = self.field.velocity(t, y[: self.n], self.mode, self.signs)
        self.signs[:] = np.where(np.isfinite(s), s, self.signs)
        return np.concatenate([F, 0.5 * (1.0 + s)])

    def event_functions(self, t: float, y: np.ndarray) -> np.ndarray:
        """Return the functions that are positive until the mode ends: distances to the surfaces,
        remaining weights, for several surfaces whether they hold the motion, and for surfaces
        between equal fields whether it stays on them and the fields stay equal."""
        field = self.field
        sliding = self.sliding
        x = y[: self.n]
        c = field.switch(t, x)
        g = self.mode * c
        more = []
        if sliding.size:
            # weights that are lost count as beyond their bounds: they are, or the arc ends there in
            # a fold
            room = field.sliding_margins(t, x, self.mode, self.signs)
            g[sliding], below = np.nan_to_num(
                room, nan=-1.0, posinf=LOST_WEIGHT, neginf=-LOST_WEIGHT
            )
            more.append(below)
            if sliding.size > 1:
                more.append([field.sliding_stability(t, x, self.mode)])
        if self.free.size:
            g[self.free] = self.away - c[self.free]
            alike = [field.fields_agree(t, x, self.signs, i) for i in self.free]
            more += [self.away + c[self.free], np.where(alike, 1.0, -1.0)]
        return np.concatenate([g, *more])

    def bands(self, t: float, x: np.ndarray) -> np.ndarray:
        """Return what rounding leaves of each event function at (t, x)."""
        weights = self.sliding.size + (self.sliding.size > 1)
        band = np.concatenate(
            [
                rounding_band(self.field, t, x, ARC_BAND),
                np.full(weights, FLAT),
                np.zeros(2 * self.free.size),
            ]
        )
        band[self.sliding] = FLAT
        band[self.free] = 0.0
        return band

    def project(self, t: float, y: np.ndarray) -> np.ndarray:
        """Return y with x projected onto the surfaces slid on."""
        x = self.field.project(t, y[: self.n], self.sliding)
        return np.concatenate([x, y[self.n :]])


class FilippovIntegrator:
    """One run: the state of the motion, its arcs, and what is recorded of them."""

    def __init__(self, case, field, options, tol, compiled=None, reason=""):
        self.compiled = compiled
        self.reason = reason  # without it: why
        self.hosted = []  # codes with which the compiled loop handed over
        self.case = case
        self.field = field
        self.options = options
        self.tol = tol
        self.t = float(case.t[0])
        self.x = case.x0.copy()
        self.n = case.n
        self.d = field.d
        field.calls = 0
        field.newton = 0
        self.theta = np.zeros(self.d)
        self.mode = np.zeros(self.d, np.int64)
        self.signs = np.zeros(self.d)
        self.events = []
        self.meetings = []
        self.idle = 0
        self.ends = None
        self.proof = {"unproven": 0, "refused": 0, "touches": 0}
        # (side it came from, time, theta) of the last entry of each surface
        self.entered = [None] * self.d
        self.arcs = 0
        self.steps = 0
        self.h = 0.0
        self.done = 1
        self.X = np.empty((len(case.t), self.n))
        self.W = np.empty((len(case.t), self.d))
        self.X.fill(np.nan)
        self.W.fill(np.nan)

    @cached_property
    def interval_fields(self):
        """Switches and fields over Jets; runs that the compiled loop ends alone never ask."""
        return interval_fields(self.case.problem)

    @cached_property
    def search(self) -> ModeSearch:
        """Search for the mode that continues."""
        return ModeSearch(
            self.field, self.case.own_time, float(self.case.t[-1] - self.case.t[0])
        )

    def run(self) -> Trajectory:
        """Follow the motion from the start of the case to its end or a failure."""
        case = self.case
        self.X[0] = self.x
        self.W[0] = 0.0
        if self.compiled is None:
            with np.errstate(all="ignore"):
                status = self.start()
                while status.ok and self.t < case.t[-1]:
                    status = self.follow_arc()
        else:
            status = self.compiled.run(self)
        if status.ok and self.done < len(self.X):
            # an event at the very end leaves the last sample to us
            self.X[self.done :] = self.x
            self.W[self.done :] = self.theta
        return Trajectory(
            case.t,
            self.X,
            tuple((0, i) for i in range(self.d)),
            self.W,
            np.empty((len(case.t), 0)),
            status,
            tuple(self.events),
            self._stats(),
            "mean",
            resolution=EVENT_DRIVEN,
        )

    def _stats(self) -> dict:
        stats = {
            "steps": self.steps,
            "h": float(self.h),
            "drift_calls": self.field.calls,
            "events": len(self.events),
            "restarts": self.arcs,
            "inner_iterations": self.field.newton,
            "loop": "host" if self.compiled is None or self.hosted else "compiled",
            "roots": "sampled" if self.proof["unproven"] else "verified",
            **self.proof,
            **describe_slow_path(
                "" if self.compiled else self.reason,
                self.hosted,
                self.proof["unproven"],
                lambda: self.interval_fields(*points(self.t, self.x), self.mode),
            ),
        }
        if self.ends is not None:
            stats["accumulation"] = float(self.ends)
        return stats

    def start(self) -> Status:
        """Choose the mode at the start."""
        c = self.field.switch(self.t, self.x)
        if not np.all(np.isfinite(c)):
            return Status("nan", f"A switch function is not finite at t = {time_text(self.t)}.")
        met = np.flatnonzero(np.abs(c) <= rounding_band(self.field, self.t, self.x))
        self.mode = np.sign(c).astype(np.int64)
        self.mode[met] = 0
        if not met.size:
            self.signs = self.mode.astype(float)
            return Status()
        status, self.mode, self.signs = self._choose(met)
        return status

    def _choose(self, met):
        return self.search.choose(self.t, self.x, self.mode, self.signs, met)

    def follow_arc(self, armed: np.ndarray | None = None) -> Status:
        """Follow the mode to its next event or the end, then choose the next mode.

        armed: which event functions can fall through zero, of an arc that goes on.
        """
        n = self.n
        equations = Arc(self.field, self.mode, self.signs, self.t, self.x)
        sliding = equations.sliding
        if sliding.size:
            self.x = self.field.project(self.t, self.x, sliding)
        arc = integrate_to_event(
            equations.derivative,
            self.t,
            np.concatenate([self.x, self.theta]),
            self.case.t[-1],
            equations.event_functions,
            method=self.options.method,
            rtol=self.tol,
            atol=self.tol,
            max_step=self.options.max_step,
            max_steps=self.options.max_steps - self.steps,
            project=equations.project if sliding.size else None,
            armed=armed,
            band=equations.bands(self.t, self.x),
            samples=self.case.t[self.done :],
            max_unproven=self.case.own_time / UNPROVEN_PARTS,
            data=lambda t, y: self.interval_fields(t, y[:n], equations.mode),
        )
        rows = slice(self.done, self.done + len(arc.samples))
        self.X[rows] = arc.samples[:, :n]
        self.W[rows] = arc.samples[:, n:]
        for k in self.proof:
            self.proof[k] += getattr(arc, k)
        self.done = rows.stop
        self.steps += arc.steps
        self.h = max(self.h, arc.h)
        self.arcs += armed is None
        self.t = float(arc.t)
        self.x = arc.y[:n]
        self.theta = arc.y[n:]
        self.signs = equations.signs
        if arc.status.ok and arc.fired.size:
            return self.pass_event(arc.fired)
        return self._explained(arc.status)

    def _explained(self, status: Status) -> Status:
        """The status of an arc; sliding may have lost its weights though the fields are finite."""
        if status.code in ("nan", "degenerate") and np.any(self.mode == 0):
            s = self.field.velocity(self.t, self.x, self.mode, self.signs)[1]
            mode = self.mode.copy()
            on = np.flatnonzero(mode == 0)
            for q in product((1, -1), repeat=on.size):
                mode[on] = q
                F = self.field.velocity(self.t, self.x, mode, self.signs)[0]
                if not np.all(np.isfinite(F)):
                    return status
            if not np.all(np.isfinite(s)) or on.size > 1:
                return Status(
                    "degenerate",
                    f"At t = {time_text(self.t)} no weights, or many, keep the state on "
                    f"{surface_names(on)}: the fields do not determine the motion.",
                )
        return status

    def pass_event(self, fired: np.ndarray) -> Status:
        """Choose the mode after an event of the event functions `fired`, and record what
        changed."""
        self.meetings.append(self.t)
        status = self._events_end()
        if not status.ok:
            return status
        c = self.field.switch(self.t, self.x)
        near = np.abs(c) <= rounding_band(self.field, self.t, self.x)
        near |= (self.mode == 0) | (self.mode == FREE)
        surfaces = fired[fired < self.d]
        near[surfaces] = True
        met = np.flatnonzero(near)
        self.field.check_complex_step(self.t, self.x)
        when, jumped = jump_time(self.field, self.t, self.x, self.mode, surfaces, self.case)
        if jumped:
            return self._pass_jump(when, jumped)
        lost = self.field.surface_missed(self.t, self.x, surfaces, self.mode, self.tol)
        if lost:
            return lost
        status, mode, signs = self._choose(met)
        if not status.ok:
            return status
        for i in met:
            if mode[i] != self.mode[i]:
                self.record_event(int(i), self.mode[i], mode[i])
        self.idle = self.idle + 1 if np.array_equal(mode, self.mode) else 0
        self.mode = mode
        self.signs = signs
        if self.idle > IDLE:
            return Status(
                "chatter",
                f"{IDLE} events on {surface_names(met)} up to t = {time_text(self.t)} changed "
                "nothing: "
                "the motion stays within rounding of the surface without being held by it.",
            )
        return Status()

    def _pass_jump(self, t: float, jumped: list[int]) -> Status:
        """Cross the surfaces whose switches jumped at t, and go on from there."""
        self.t = t
        for i in jumped:
            self.record_event(i, self.mode[i], -self.mode[i])
            self.mode[i] = -self.mode[i]
            self.signs[i] = self.mode[i]
        near = np.abs(self.field.switch(t, self.x)) <= rounding_band(self.field, t, self.x)
        near |= (self.mode == 0) | (self.mode == FREE)
        if near.any():  # the fields that hold the motion on another surface have changed
            status, self.mode, self.signs = self._choose(np.flatnonzero(near))
            return status
        return Status()

    def _events_end(self) -> Status:
        """Chatter if events accumulate or are too many."""
        self.ends = ends = accumulation(self.meetings, self.case.own_time)
        if ends is not None:
            return Status(
                "chatter",
                f"Events accumulate at t = {time_text(ends)}: following events cannot pass that "
                "time.",
            )
        if len(self.meetings) > self.options.max_events:
            return Status(
                "chatter",
                f"{len(self.meetings)} events were met by t = {time_text(self.t)}; raise "
                "max_events.",
            )
        return Status()

    def record_event(self, i: int, old: int, new: int) -> None:
        """Record the event of surface i at self.t, from one mode to another; a touch is none.

        The motion touches a surface where it would have entered and left to the side it came from
        with all but no other weight in between: below the tolerance of the arcs nothing tells the
        two apart.
        """
        if FREE in (old, new):
            if 0 in (old, new):
                self.events.append(Event(self.t, "exit" if old == 0 else "enter", (0, i)))
            return
        if new == 0:
            self.entered[i] = old, self.t, self.theta[i]
        elif old == 0 and self.entered[i] is not None:
            side, t, theta = self.entered[i]
            weight = abs(self.theta[i] - theta - (new > 0) * (self.t - t))
            if side == new and weight <= TOUCH * self.tol:
                last = max(k for k, e in enumerate(self.events) if e.contact == (0, i))
                del self.events[last]
                self.proof["touches"] += 1
                return
        kind = "enter" if new == 0 else "exit" if old == 0 else "cross"
        self.events.append(Event(self.t, kind, (0, i)))
