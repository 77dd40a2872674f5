"""The compiled walk of a Filippov system, and what is handed over between it and
solvers._switching.

Taylor series of all operations of the case (solvers._tape, kernels.filippov) replace the
Runge-Kutta steps of the host; the functions of the case are proven to hide nothing on every step.
Wherever a choice is not plain, or a step not proven, the host goes on from the state the kernel
stopped in, and the kernel takes over again after the next event.
"""

from __future__ import annotations

import numpy as np

from nsbench.dynamics.filippov.vector_field import EPS
from nsbench.solvers.event_driven.filippov.program import ROOM, SHARE, order
from nsbench.trajectory import Status

# the code of a walk that is at its end (kernels.filippov)
END = 0
OK = Status()
GROWN = 1e6  # times its start: a state whose steps vanish has gone to infinity (as in _arc)


class Compiled:
    """One case, ready to run."""

    def __init__(self, tape, case, options, tol):
        from nsbench.solvers.event_driven.filippov.kernels import loop as kernel

        self.kernel, self.tape, self.p, self.options = kernel, tape, order(tol), options
        self.limits = np.array(
            [
                case.t[-1] - case.t[0],
                max(SHARE * tol, EPS),
                options.max_step,
                options.max_steps,
                options.max_events,
            ]
        )
        self.scratch = tape.scratch(self.p)
        self.span = float(case.t[-1])
        self.log = np.empty((ROOM, 2))
        self.logged = np.empty((ROOM, 3), np.int64)
        self.ring = np.zeros(7)
        self.armed = np.zeros(tape.d + 1, np.bool_)
        self.numbers = np.zeros(9, np.int64)
        self.floats = np.zeros(2)

    def go(self, walk) -> Status:
        """Follow `walk` from its start to the end or a failure, with the host's help where a choice
        is not plain."""
        code, fired, going = self._walk(walk, 0)
        if code == END:  # most runs: nothing of the host is set up for them
            return OK
        with np.errstate(all="ignore"):
            status = self._helped(walk, code, fired, going)
            while status.ok and walk.t < self.span:
                code, fired, going = self._walk(walk, 1)
                status = OK if code == END else self._helped(walk, code, fired, going)
        return status

    def _walk(self, walk, begun: int) -> tuple[int, int, int]:
        """Walk on, compiled, and write down where to: code, the function that fired, and whether
        the arc goes on."""
        tape = self.tape
        kernel = self.kernel
        ring = self.ring
        numbers = self.numbers
        floats = self.floats
        last = walk.meetings[-7:]
        if last:
            ring[7 - len(last) :] = last
        numbers[:] = (
            0,
            walk.done,
            walk.steps,
            walk.arcs,
            walk.motion.calls,
            0,
            len(walk.meetings),
            0,
            0,
        )
        floats[:] = walk.t, walk.h
        while True:
            kernel.integrate_modes(
                *tape.arrays,
                tape.table,
                tape.slides,
                self.p,
                self.limits,
                begun,
                numbers,
                floats,
                walk.x,
                walk.theta,
                walk.mode,
                self.armed,
                ring,
                walk.case.t,
                walk.X,
                walk.W,
                self.log,
                self.logged,
                self.scratch,
            )
            code, walk.done, walk.steps, walk.arcs, walk.motion.calls, events, _, fired, going = (
                numbers.tolist()
            )
            if events:
                self._replay(walk, events)
            if code != kernel.FULL:
                break
            begun = 1
            numbers[kernel.EVENTS] = 0
        walk.t, walk.h = floats.tolist()
        return code, fired, going

    def _helped(self, walk, code, fired, going) -> Status:
        """What the host makes of the state in which the compiled walk stopped."""
        kernel = self.kernel
        walk.signs = np.where(np.abs(walk.mode) == 1, walk.mode, 0.0)
        if code == kernel.STEPS:
            return Status(
                "maxiter", f"{self.options.max_steps} steps were taken by t = {walk.t:.9g}."
            )
        size = np.abs(walk.x).max(initial=0.0)
        if (
            code == kernel.HARD
            and fired == kernel.TINY
            and size > GROWN * (1.0 + np.abs(walk.case.x0).max(initial=0.0))
        ):
            return Status("diverged", f"The state grew to {size:.3g} at t = {walk.t:.9g}.")
        walk.hosted += 1
        if code == kernel.START:
            return walk._start()
        if code == kernel.MEET:
            return walk._meet(np.array([fired]))
        one = not np.any(walk.mode == 0)
        return walk._arc((self.armed[:-1] if one else self.armed).copy() if going else None)

    def _replay(self, walk, count):
        """Record the events that the kernel met."""
        state = walk.t, walk.theta
        for (t, weight), (i, old, new) in zip(
            self.log[:count].tolist(), self.logged[:count].tolist(), strict=True
        ):
            walk.t = t
            walk.theta = {i: weight}
            walk.meetings.append(t)
            walk.idle = 0
            walk._record(i, old, new)
        walk.t, walk.theta = state
