"""The compiled walk of a Filippov system, and what is handed over between it and solvers._switching.

Taylor series of all operations of the case (solvers._tape, kernels.filippov) replace the Runge-Kutta steps of the host; the
functions of the case are proven to hide nothing on every step. Wherever a choice is not plain, or a step not proven, the
host goes on from the state the kernel stopped in, and the kernel takes over again after the next event.
"""
from __future__ import annotations

import numpy as np

from nsbench.solvers._sliding import EPS
from nsbench.solvers._tape import ROOM, SHARE, order
from nsbench.trajectory import Status

GROWN = 1e6             # times its start: a state whose steps vanish has gone to infinity (as in _arc)


class Compiled:
    """One case, ready to run: go(walk, begun) follows `walk` until the end, a failure, or the next event the host met."""

    def __init__(self, tape, case, options, tol):
        self.tape, self.p, self.options = tape, order(tol), options
        self.limits = np.array([case.t[-1] - case.t[0], max(SHARE * tol, EPS), options.max_step, options.max_steps,
                                options.max_events])
        self.scratch = tape.scratch(self.p)
        self.log, self.logged = np.empty((ROOM, 2)), np.empty((ROOM, 3), np.int64)

    def go(self, walk, begun: int) -> Status:
        from nsbench.kernels import filippov as kernel
        ring, armed = np.zeros(7), np.zeros(walk.d + 1, np.bool_)
        last = walk.meetings[-7:]
        ring[7 - len(last):] = last
        numbers = np.array([0, walk.done, walk.steps, walk.arcs, walk.motion.calls, 0, len(walk.meetings), 0, 0])
        floats = np.array([walk.t, walk.h])
        while True:
            numbers[kernel.EVENTS] = 0
            tape = self.tape
            kernel.walk(*tape.arrays, tape.table, tape.slides, self.p, self.limits, begun, numbers, floats, walk.x, walk.theta,
                        walk.mode, armed, ring, walk.case.t, walk.X, walk.W, self.log, self.logged, self.scratch)
            self._replay(walk, int(numbers[kernel.EVENTS]))
            if numbers[kernel.CODE] != kernel.FULL:
                break
            begun = 1
        code, walk.done, walk.steps, walk.arcs, walk.motion.calls, _, _, fired, going = (int(v) for v in numbers)
        walk.t, walk.h = float(floats[kernel.TIME]), float(floats[kernel.LONGEST])
        if code == kernel.END:
            return Status()
        walk.signs = np.where(np.abs(walk.mode) == 1, walk.mode, 0.0)
        if code == kernel.STEPS:
            return Status("maxiter", f"{self.options.max_steps} steps were taken by t = {walk.t:.9g}.")
        size = np.abs(walk.x).max(initial=0.0)
        if code == kernel.HARD and fired == kernel.TINY and size > GROWN * (1.0 + np.abs(walk.case.x0).max(initial=0.0)):
            return Status("diverged", f"The state grew to {size:.3g} at t = {walk.t:.9g}.")
        walk.hosted += 1
        if code == kernel.START:
            return walk._start()
        if code == kernel.MEET:
            return walk._meet(np.array([fired]))
        one = not np.any(walk.mode == 0)
        return walk._arc((armed[:-1] if one else armed) if going else None)

    def _replay(self, walk, count):
        """Record the events that the kernel met."""
        state = walk.t, walk.theta
        for (t, weight), (i, old, new) in zip(self.log[:count].tolist(), self.logged[:count].tolist(), strict=True):
            walk.t, walk.theta = t, {i: weight}
            walk.meetings.append(t)
            walk.idle = 0
            walk._record(i, old, new)
        walk.t, walk.theta = state
