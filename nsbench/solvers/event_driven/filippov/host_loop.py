"""The event-driven method on Filippov systems: smooth arcs in one mode, joined where the mode
changes.

At a meeting with surfaces every mode of the surfaces met is a candidate: beside a surface if the
motion leads away from it, on it if the weights that hold it there lie in [0, 1]. Where the first
derivative vanishes (tangential exits) a short trial motion decides. No candidate, or several with
different motions, is an answer: the run says so and stops.
Where both sides of a surface have the same field nothing happens on it; a motion that stays on it
is let go on.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from nsbench.case import Case
from nsbench.dynamics.filippov.vector_field import EPS, FREE, FilippovVectorField
from nsbench.dynamics.length_scale import case_length_scale
from nsbench.solvers.base import Run
from nsbench.solvers.event_driven.accumulation import accumulation
from nsbench.solvers.event_driven.filippov.compiled_loop import Compiled
from nsbench.solvers.event_driven.filippov.program import tape
from nsbench.solvers.event_driven.smooth.arc import integrate_to_event
from nsbench.trajectory import Event, Resolution, Status, Trajectory

TRIALS = 10.0 ** np.arange(
    -7, -2
)  # lengths of trial motions as parts of the run: the first sign shown decides
FLAT = 1e-7  # relative size below which a first derivative decides nothing
AWAY = 1e-9  # relative distance at which a surface is left that does not hold the motion
TOUCH = 100.0  # tolerances of the arcs: less weight than this cannot be told from a touch
IDLE = 1000  # events in a row that leave the mode as it is before the run is called stuck


def prepare(case: Case, options, tol: float) -> Run:
    """A Run of a Filippov case; options are EventDriven's, tol is the tolerance of the arcs.

    Its trajectory has the integrals of theta and the events enter, exit and cross with contact (0,
    i).
    """
    motion = FilippovVectorField(case.problem, float(case.t[0]), case.x0)
    series = options.method == "dop853" and options.compiled
    made = tape(case.problem, motion.d, float(case.t[0]), case.x0) if series else None
    fast = None if made is None else Compiled(made, case, options, tol)
    return lambda: FilippovIntegrator(case, motion, options, tol, fast).run()


class FilippovIntegrator:
    def __init__(self, case, motion, options, tol, fast=None):
        # the compiled walk, and how often it had to be helped
        self.fast = fast
        self.hosted = 0
        self.case = case
        self.motion = motion
        self.options = options
        self.tol = tol
        self.t, self.x, self.n, self.d = float(case.t[0]), case.x0.copy(), case.n, motion.d
        motion.calls = motion.newton = 0
        self.unit = unit = case_length_scale(case)
        self.size = (
            1.0 if unit == 1.0 else np.append(np.full(self.n, unit), np.ones(self.d))
        )  # of a state and of weights
        self.theta = np.zeros(self.d)
        self.mode = np.zeros(self.d, np.int64)
        self.signs = np.zeros(self.d)
        self.events = []
        self.meetings = []
        self.idle = 0
        self.ends = None
        self.proof = {"unproven": 0, "refused": 0, "touches": 0}
        self.entered = [
            None
        ] * self.d  # (side it came from, time, theta) of the last entry of each surface
        self.arcs = 0
        self.steps = 0
        self.h = 0.0
        self.done = 1
        self.X, self.W = (np.full((len(case.t), k), np.nan) for k in (self.n, self.d))

    def run(self) -> Trajectory:
        case = self.case
        self.X[0] = self.x
        self.W[0] = 0.0
        if self.fast is None:
            with np.errstate(all="ignore"):
                status = self._start()
                while status.ok and self.t < case.t[-1]:
                    status = self._arc()
        else:
            status = self.fast.go(self)
        if status.ok and self.done < len(
            self.X
        ):  # an event at the very end leaves the last sample to us
            self.X[self.done :], self.W[self.done :] = self.x, self.theta
        stats = {
            "steps": self.steps,
            "h": float(self.h),
            "drift_calls": self.motion.calls,
            "events": len(self.events),
            "restarts": self.arcs,
            "inner_iterations": self.motion.newton,
            "loop": "host" if self.fast is None or self.hosted else "compiled",
            "roots": "sampled" if self.proof["unproven"] else "verified",
            **self.proof,
        }
        if self.ends is not None:
            stats["accumulation"] = float(self.ends)
        return Trajectory(
            case.t,
            self.X,
            tuple((0, i) for i in range(self.d)),
            self.W,
            np.empty((len(case.t), 0)),
            status,
            tuple(self.events),
            stats,
            "mean",
            resolution=Resolution(),
        )

    def _start(self) -> Status:
        c = self.motion.switch(self.t, self.x)
        if not np.all(np.isfinite(c)):
            return Status("nan", f"A switch function is not finite at t = {self.t:.9g}.")
        met = np.flatnonzero(np.abs(c) <= self._band(self.t, self.x))
        self.mode = np.sign(c).astype(np.int64)
        self.mode[met] = 0
        status, mode, signs = (
            self._choose(met) if met.size else (Status(), self.mode, self.mode.astype(float))
        )
        self.mode = mode
        self.signs = signs
        return status

    def _band(self, t, x, times=1e3):
        """(d,) what rounding and the location of events leave of c_i on its surface: 1000 eps of
        its terms."""
        G = self.motion.gradients(t, x, np.arange(self.d))
        pace = np.abs(
            self.motion.along(t, x, 1.0, np.zeros(self.n))
        )  # a surface that only time moves rounds too
        return times * EPS * (np.abs(G) @ (1.0 + np.abs(x)) + pace * (1.0 + abs(t)))

    def _arc(self, armed=None) -> Status:
        """Follow the mode to its next event or the end, then choose the next mode. armed: of an arc
        that goes on."""
        motion = self.motion
        mode = self.mode
        guess = self.signs.copy()
        n = self.n
        T = self.case.t[-1]
        on = np.flatnonzero(mode == 0)
        free = np.flatnonzero(mode == FREE)
        away = AWAY / EPS * self._band(self.t, self.x, 1.0)[free]

        def rhs(t, y):
            F, s = motion.velocity(t, y[:n], mode, guess)
            guess[:] = np.where(np.isfinite(s), s, guess)
            return np.concatenate([F, 0.5 * (1.0 + s)])

        def gaps(t, y):
            c = motion.switch(t, y[:n])
            g = mode * c
            more = []
            if on.size:
                # weights that are lost count as beyond their bounds: they are, or the arc ends
                # there in a fold
                g[on], below = np.nan_to_num(
                    motion.room(t, y[:n], mode, guess), nan=-1.0, posinf=1e3, neginf=-1e3
                )
                more.append(below)
                if on.size > 1:
                    more.append([motion.held(t, y[:n], mode)])
            if free.size:
                g[free] = away - c[free]
                alike = [motion.same(t, y[:n], guess, i) for i in free]
                more += [away + c[free], np.where(alike, 1.0, -1.0)]
            return np.concatenate([g, *more])

        def project(t, y):
            x = motion.project(t, y[:n], on)
            return None if x is y[:n] else np.concatenate([x, y[n:]])

        if on.size:
            self.x = motion.project(self.t, self.x, on)
        band = np.concatenate(
            [
                self._band(self.t, self.x, 16.0),
                np.full(on.size + (on.size > 1), FLAT),
                np.zeros(2 * free.size),
            ]
        )
        band[on] = FLAT
        band[free] = 0.0
        later = self.case.t[self.done :]
        arc = integrate_to_event(
            rhs,
            self.t,
            np.concatenate([self.x, self.theta]),
            T,
            gaps,
            method=self.options.method,
            rtol=self.tol,
            atol=self.tol * self.size,
            max_step=self.options.max_step,
            max_steps=self.options.max_steps - self.steps,
            project=project if on.size else None,
            armed=armed,
            band=band,
            samples=later,
            data=lambda t, y: motion.data(t, y[:n], mode),
        )
        rows = slice(self.done, self.done + len(arc.samples))
        self.X[rows], self.W[rows] = arc.samples[:, :n], arc.samples[:, n:]
        for k in self.proof:
            self.proof[k] += getattr(arc, k)
        self.done, self.steps, self.h = rows.stop, self.steps + arc.steps, max(self.h, arc.h)
        self.arcs += armed is None
        self.t = float(arc.t)
        self.x = arc.y[:n]
        self.theta = arc.y[n:]
        self.signs = guess
        return (
            self._meet(arc.fired)
            if arc.status.ok and arc.fired.size
            else self._explained(arc.status)
        )

    def _explained(self, status):
        """A failed arc in words: sliding may have lost its weights though the fields are finite."""
        if status.code in ("nan", "degenerate") and np.any(self.mode == 0):
            s = self.motion.velocity(self.t, self.x, self.mode, self.signs)[1]
            mode = self.mode.copy()
            on = np.flatnonzero(mode == 0)
            for q in product((1, -1), repeat=on.size):
                mode[on] = q
                if not np.all(
                    np.isfinite(self.motion.velocity(self.t, self.x, mode, self.signs)[0])
                ):
                    return status
            if not np.all(np.isfinite(s)) or on.size > 1:
                return Status(
                    "degenerate",
                    f"At t = {self.t:.9g} no weights, or many, keep the state on "
                    f"{self._named()}: the fields do not determine the motion.",
                )
        return status

    def _named(self, rows=None):
        rows = np.flatnonzero(self.mode == 0) if rows is None else rows
        return f"surface {rows[0]}" if len(rows) == 1 else f"surfaces {', '.join(map(str, rows))}"

    def _meet(self, fired) -> Status:
        """Choose the mode after an event, and record what changed."""
        self.meetings.append(self.t)
        self.ends = ends = accumulation(self.meetings, self.case.t[-1] - self.case.t[0])
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
        c = self.motion.switch(self.t, self.x)
        near = (np.abs(c) <= self._band(self.t, self.x)) | (self.mode == 0) | (self.mode == FREE)
        near[fired[fired < self.d]] = True
        met = np.flatnonzero(near)
        self.motion.trust(self.t, self.x)
        lost = self.motion.lost(self.t, self.x, fired[fired < self.d], self.mode, self.tol)
        status, mode, signs = (lost, None, None) if lost else self._choose(met)
        if not status.ok:
            return status
        for i in met:
            if mode[i] != self.mode[i]:
                self._record(int(i), self.mode[i], mode[i])
        self.idle = self.idle + 1 if np.array_equal(mode, self.mode) else 0
        self.mode = mode
        self.signs = signs
        if self.idle > IDLE:
            return Status(
                "chatter",
                f"{IDLE} events on {self._named(met)} up to t = {self.t:.9g} changed nothing: "
                "the motion stays within rounding of the surface without being held by it.",
            )
        return Status()

    def _record(self, i, old, new):
        """Add the event of surface i at self.t, from one mode to another; a touch is none.

        The motion touches a surface where it would have entered and left to the side it came from
        with all but no other weight in between: below the tolerance of the arcs nothing tells the
        two apart.
        """
        if FREE in (old, new):
            self.events += (
                [Event(self.t, "exit" if old == 0 else "enter", (0, i))] if 0 in (old, new) else []
            )
            return
        if new == 0:
            self.entered[i] = old, self.t, self.theta[i]
        elif old == 0 and self.entered[i] is not None and self.entered[i][0] == new:
            _, t, theta = self.entered[i]
            weight = abs(self.theta[i] - theta - (new > 0) * (self.t - t))
            last = max(k for k, e in enumerate(self.events) if e.contact == (0, i))
            if weight <= TOUCH * self.tol:
                del self.events[last]
                self.proof["touches"] += 1
                return
        kind = "enter" if new == 0 else "exit" if old == 0 else "cross"
        self.events.append(Event(self.t, kind, (0, i)))

    def _choose(self, met):
        """(status, mode, signs) among the modes of the surfaces met; sliding first."""
        good = []
        mode = self.mode.copy()
        size = np.zeros(self.d)
        known = True
        s = self.signs
        for q in product((1, -1), repeat=met.size):
            mode[met] = q
            F, s = self.motion.velocity(self.t, self.x, mode, self.signs)
            known = known and bool(np.all(np.isfinite(F)))
            size = np.fmax(size, np.abs(self.motion.along(self.t, self.x, 1.0, F)))
        ways = [
            (FREE, 1, -1) if known and self.motion.same(self.t, self.x, s, i) else (0, 1, -1)
            for i in met
        ]
        for q in product(*ways):
            mode = self.mode.copy()
            mode[met] = q
            for s in self.motion.branches(self.t, self._onto(mode), mode):
                ahead = self._holds(mode, s, met, size)
                if ahead is not None:
                    good.append((mode, s, ahead))
        if not good and not known:
            return (
                Status(
                    "nan", f"The drift is not finite on {self._named(met)} at t = {self.t:.9g}."
                ),
                None,
                None,
            )
        if not good:
            return (
                Status(
                    "degenerate",
                    f"At t = {self.t:.9g} no motion continues from {self._named(met)}.",
                ),
                None,
                None,
            )
        mode, signs, ahead = good[0]
        for _, _, other in good[1:]:
            # trials that lead where weights are lost are not numbers; the shorter ones decide then
            if not np.nanmax(np.abs(other - ahead)) <= 1e-12 * (
                self.unit + np.nanmax(np.abs(ahead))
            ):
                return (
                    Status(
                        "degenerate",
                        f"At t = {self.t:.9g} several motions continue from {self._named(met)}: "
                        "the solution is not unique there.",
                    ),
                    None,
                    None,
                )
        return Status(), mode, signs

    def _onto(self, mode):
        on = np.flatnonzero(mode == 0)
        return self.motion.project(self.t, self.x, on) if on.size else self.x

    def _holds(self, mode, s, met, size):
        """Trial states if the mode with signs s is a motion from here, else None; size (d,):
        largest |c_i'| beside it."""
        t = self.t
        x = self._onto(mode)
        motion = self.motion
        F, s = motion.velocity(t, x, mode, s)
        if not (np.all(np.isfinite(s)) and np.all(np.isfinite(F))):
            return None
        value = np.zeros(self.d)
        rate = motion.along(t, x, 1.0, F)
        for i in met:
            value[i] = (
                1.0 - abs(s[i])
                if mode[i] == 0
                else (-abs(rate[i]) if mode[i] == FREE else mode[i] * rate[i]) / (size[i] or 1.0)
            )
        if np.any(value[met] < -FLAT):
            return None
        open_ = [i for i in met if value[i] <= FLAT]
        signs = np.zeros(len(open_))
        ahead = []
        for part in TRIALS:
            h = part * (self.case.t[-1] - self.case.t[0])
            after, state, weights = self._trial(mode, t, x, s, h)
            ahead.append(state)
            c = motion.switch(after, state)
            band = self._band(after, state)
            for k, i in enumerate(open_):
                v, least = (
                    (1.0 - abs(weights[i]), 1e-2 * FLAT)
                    if mode[i] == 0
                    else (mode[i] * c[i], band[i] / 10)
                )
                if mode[i] == FREE:
                    off = abs(c[i]) - band[i]
                    if off > 0.0:  # what two half steps see otherwise is the error of the trial
                        _, other, _ = self._trial(mode, *self._trial(mode, t, x, s, h / 2), h / 2)
                        off -= 4.0 * abs(c[i] - motion.switch(after, other)[i])
                    v = -1.0 if off > 0.0 or not motion.same(after, state, weights, i) else 0.0
                    least = 0.0
                if signs[k] == 0.0 and abs(v) > least:
                    signs[k] = np.sign(v)
        return None if np.any(signs < 0.0) else np.array(ahead)

    def _trial(self, mode, t, x, s, h):
        """(time, state, signs) after one classical Runge-Kutta step of length h from (t, x, s) in
        the mode."""
        v = self.motion.velocity
        k1 = v(t, x, mode, s)[0]
        k2 = v(t + h / 2, x + h / 2 * k1, mode, s)[0]
        k3 = v(t + h / 2, x + h / 2 * k2, mode, s)[0]
        k4 = v(t + h, x + h * k3, mode, s)[0]
        y = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return t + h, y, v(t + h, y, mode, s)[1]
