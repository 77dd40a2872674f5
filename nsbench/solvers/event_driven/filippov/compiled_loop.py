"""Driver of the compiled Filippov loop, and what is handed over between it and the host.

Taylor series of all operations of the case (event_driven.filippov.program, kernels.loop) replace
the Runge-Kutta steps of the host, and every step is proven to hide no event. Wherever a choice of
the mode is not certain, or a step cannot be certified, the host goes on from the state in which the
kernel stopped, and the kernel takes over again after the next event.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from nsbench.case.scale import size_text, time_text
from nsbench.dynamics.filippov.vector_field import EPS
from nsbench.compilation.case_functions import entry_point
from nsbench.solvers.event_driven.filippov.kernels import loop_state as codes
from nsbench.solvers.event_driven.filippov.kernels.loop_state import Settings
from nsbench.solvers.event_driven.filippov.program import (
    LOCAL_SHARE,
    TracedPrograms,
    series_order,
)
from nsbench.trajectory import Status

MOST_LOGGED = 256  # events that one call of the kernel can log
GROWTH = 1e6  # times its start: a state whose steps vanish has gone to infinity (as in smooth.arc)
OK = Status()


class Stop(NamedTuple):
    """Why the compiled loop stopped (code of loop_state), the watched function that fell, and
    whether the arc goes on."""

    code: int
    fired: int
    goes_on: bool


class CompiledLoop:
    """Compiled loop of one case."""

    def __init__(self, programs: TracedPrograms, case, options, tol: float):
        from nsbench.solvers.event_driven.filippov.kernels import loop

        self.kernel = loop
        self.programs = programs
        self.max_steps = options.max_steps
        self.settings = Settings(
            order=series_order(tol),
            span=case.own_time,
            local_error=float(max(LOCAL_SHARE * tol, EPS)),
            longest_step=float(options.max_step),
            steps=options.max_steps,
            events=options.max_events,
        )
        # what is the same in all calls of the kernel: unpacking named tuples in each costs more
        traced = programs.programs
        self.constant = (*traced[:-1], *traced.kinks, *programs.modes, *self.settings)
        self.work = tuple(programs.workspace(self.settings.order))
        self.end = float(case.t[-1])
        self.log = np.empty((MOST_LOGGED, 2))
        self.logged = np.empty((MOST_LOGGED, 3), np.int64)
        self.ring = np.zeros(codes.RING)
        self.armed = np.zeros(programs.watches, np.bool_)
        self.counters = np.zeros(codes.COUNTERS, np.int64)
        self.floats = np.zeros(codes.FLOATS)
        self.integrate_modes: Callable | None = None  # the kernel, once its types are known

    def run(self, host) -> Status:
        """Follow the motion of `host`, a FilippovIntegrator, from its start to the end or a
        failure, with its help where a choice is not certain."""
        stop = self._integrate(host, self.kernel.CHOOSE_START)
        if stop.code == codes.END:  # most runs: nothing of the host is set up for them
            return OK
        with np.errstate(all="ignore"):
            status = self._hand_over(host, stop)
            while status.ok and host.t < self.end:
                stop = self._integrate(host, self.kernel.ARC_BEGINS)
                status = OK if stop.code == codes.END else self._hand_over(host, stop)
        return status

    def _integrate(self, host, begun: int) -> Stop:
        """Go on, compiled, and write where to into `host`."""
        counters = self.counters
        floats = self.floats
        latest = host.meetings[-codes.RING :]
        if latest:
            self.ring[codes.RING - len(latest) :] = latest
        # in the order CODE, DONE, COUNT, ARCS, CALLS, EVENTS, MEETINGS, FIRED, CARRY
        counters[:] = (
            0,
            host.done,
            host.steps,
            host.arcs,
            host.field.calls,
            0,
            len(host.meetings),
            0,
            0,
        )
        floats[:] = (host.t, host.h)
        motion = (host.x, host.theta, host.mode, self.armed)
        records = (host.case.t, host.X, host.W, self.log, self.logged, self.ring)
        while True:
            args = (*self.constant, *motion, *records, counters, floats, self.work, begun)
            if self.integrate_modes is None:
                self.integrate_modes = entry_point(self.kernel.integrate_modes, args)
            self.integrate_modes(*args)
            (
                code,
                host.done,
                host.steps,
                host.arcs,
                host.field.calls,
                events,
                _,
                fired,
                goes_on,
            ) = counters.tolist()
            if events:
                self._replay_events(host, events)
            if code != codes.FULL:
                break
            begun = self.kernel.ARC_BEGINS
            counters[codes.EVENTS] = 0
        host.t, host.h = floats.tolist()
        return Stop(code, fired, bool(goes_on))

    def _hand_over(self, host, stop: Stop) -> Status:
        """Let the host go on from the state in which the compiled loop stopped."""
        host.signs = np.where(np.abs(host.mode) == 1, host.mode, 0.0)
        if stop.code == codes.STEPS:
            return Status(
                "maxiter", f"{self.max_steps} steps were taken by t = {time_text(host.t)}."
            )
        if stop.code == codes.KINK:
            return Status(
                "degenerate",
                f"At t = {time_text(host.t)} the drift jumps at {self.programs.places[stop.fired]} "
                "and both sides lead to the jump: write it as a switching surface of a Filippov "
                "system, whose sliding is defined.",
            )
        if stop.code == codes.APART:
            return Status(
                "degenerate",
                f"At t = {time_text(host.t)} the drift jumps at {self.programs.places[stop.fired]} "
                "and both sides lead away from the jump: several motions start there.",
            )
        size = np.abs(host.x).max(initial=0.0)
        vanishes = stop.code == codes.HARD and stop.fired == codes.STEP_VANISHES
        if vanishes and size > GROWTH * (1.0 + np.abs(host.case.x0).max(initial=0.0)):
            return Status(
                "diverged", f"The state grew to {size_text(size)} at t = {time_text(host.t)}."
            )
        host.hosted.append(stop.code)
        if stop.code == codes.START:
            return host.start()
        if stop.code == codes.MEET:
            return host.pass_event(np.array([stop.fired]))
        if not stop.goes_on:
            return host.follow_arc()
        slides = np.any(host.mode == 0)  # the last watched function is the weight's
        armed = np.append(self.armed[: self.programs.d], self.armed[-1:])
        return host.follow_arc(armed if slides else armed[:-1])

    def _replay_events(self, host, count: int) -> None:
        """Record the events that the kernel logged."""
        t = host.t
        theta = host.theta
        for (time, weight), (i, old, new) in zip(
            self.log[:count].tolist(), self.logged[:count].tolist(), strict=True
        ):
            host.t = time
            host.theta = {i: weight}
            host.meetings.append(time)
            host.idle = 0
            host.record_event(i, old, new)
        host.t = t
        host.theta = theta
