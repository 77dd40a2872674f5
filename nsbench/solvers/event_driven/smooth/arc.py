"""Integrate a smooth differential equation up to the first of several events.

The steppers of the table of integrators take the steps. Every accepted step is split into pieces
on which the functions of the case are proven to be smooth (see pieces), and events are roots of
interpolants on the pieces (see crossings). Where a proof fails because of the way a function is
written, the equation is tested at more points and steps are bounded. A step that missed something
of the drift is refused: on the pieces that needed halving the path must satisfy the equation.

At an event the step is repeated with its end there, because the dense output is of lower order than
the step. Steps also end at the sample times, for the same reason.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nsbench.case.scale import time_text
from nsbench.solvers.event_driven.smooth.crossings import EventFunctions
from nsbench.solvers.event_driven.smooth.failure_status import failed_step
from nsbench.solvers.event_driven.smooth.integrators import INTEGRATORS, STIFF_INTEGRATOR
from nsbench.solvers.event_driven.smooth.pieces import (
    shorter_step,
    single_piece,
    split_where_smooth,
)
from nsbench.solvers.event_driven.smooth.stall import STALL_MESSAGE, StallDetector
from nsbench.solvers.event_driven.smooth.stepper import CountedFunction, take_step
from nsbench.solvers.event_driven.smooth.stiffness import StiffnessDetector
from nsbench.trajectory import Status

# Part of the tolerance for one step: a run takes tens, and kinks of a drift deceive estimates.
STEP_SHARE = 0.03
MAX_REFUSALS = 40  # of steps in a row, each shorter than the one before
UNPROVEN_PARTS = 64  # the longest step where nothing is proven is the arc over this
_MIN_RTOL = 16 * np.finfo(float).eps  # tolerances below SciPy's own floor are raised to it


@dataclass
class Arc:
    """Result of integrate_to_event.

    t, y: end of the arc. fired: indices of the functions whose event that is, empty at t_end.
    samples (s, n): states at the sample times reached. status: ok, or why the arc stopped early.
    steps, calls (of rhs), h: the largest step. unproven: steps with a part on which nothing is
    proven. refused: steps taken again. touches: dips that count as no event.
    """

    t: float
    y: np.ndarray
    fired: np.ndarray
    samples: np.ndarray
    status: Status
    steps: int
    calls: int
    h: float
    unproven: int = 0
    refused: int = 0
    touches: int = 0


@dataclass(frozen=True)
class ArcProblem:
    """Arguments of integrate_to_event that hold for the whole arc; see there."""

    rhs: Callable
    t0: float
    y0: np.ndarray
    t_end: float
    gaps: Callable | None
    method: str
    rtol: float
    atol: float | np.ndarray
    max_step: float
    project: Callable | None
    armed: np.ndarray | None
    band: float | np.ndarray
    samples: np.ndarray
    data: Callable | None
    max_unproven: float


def integrate_to_event(
    rhs: Callable,
    t0: float,
    y0: np.ndarray,
    t_end: float,
    gaps: Callable | None = None,
    *,
    method: str = "dop853",
    rtol: float = 1e-12,
    atol: float | np.ndarray | None = None,
    max_step: float = np.inf,
    project: Callable | None = None,
    armed: np.ndarray | None = None,
    band: float | np.ndarray = 0.0,
    samples: np.ndarray = (),
    max_steps: int = 1_000_000,
    first_step: float | None = None,
    data: Callable | None = None,
    max_unproven: float = np.inf,
) -> Arc:
    """Integrate y' = rhs(t, y) from t0 to t_end or to the first event.

    gaps(t, y) -> (m,): event functions, positive before their event. An armed function fires where
    it crosses zero downward. One that is not armed (by default: at most `band` at the start) fires
    where it falls `band` below min(its start, 0), and is armed once it exceeds `band`: a function
    that starts at zero must not fire on rounding. project(t, y) -> y or None (nothing to do):
    removes the drift off an invariant after every step. samples: sorted times in (t0, t_end] at
    which steps end. max_step: bound on a step. method: a name of INTEGRATORS. rtol, atol: intended
    error of the run; a step gets STEP_SHARE of it. data(t, y) -> sequence: the functions of the
    case that rhs and gaps are made of, written over arrays. They are called with Jets (see
    interval_taylor) to prove that nothing is missed between steps. None: nothing is proven.
    max_unproven: bound on steps on which nothing is proven.
    """
    problem = ArcProblem(
        rhs=rhs,
        t0=float(t0),
        y0=np.array(y0, float),
        t_end=float(t_end),
        gaps=gaps,
        method=method,
        rtol=rtol,
        atol=rtol if atol is None else atol,
        max_step=max_step,
        project=project,
        armed=armed,
        band=band,
        samples=samples,
        data=data,
        max_unproven=max_unproven,
    )
    with np.errstate(all="ignore"):
        return _ArcIntegrator(problem).run(max_steps, first_step)


class _ArcIntegrator:
    """State of one arc: time, state, stepper settings and counts."""

    def __init__(self, problem: ArcProblem):
        y0 = problem.y0
        self.integrator = INTEGRATORS[problem.method]
        self.stepper = self.integrator.load()
        # a stepper of a multistep method is new after each stop, also where radau took over later
        self.restart = self.integrator.multistep
        self.fun = CountedFunction(problem.rhs)
        self.project = problem.project
        self.max_step = problem.max_step
        self.data = problem.data
        eps = np.finfo(float).eps
        rtol = problem.rtol
        atol = problem.atol
        # An impulse is a difference of two states: it has no more digits than the largest of them.
        least = np.maximum(
            _MIN_RTOL * np.minimum(1.0, atol / rtol), eps * np.abs(y0).max(initial=0.0)
        )
        self.rtol = max(STEP_SHARE * rtol, 100 * eps)
        self.atol = np.maximum(STEP_SHARE * atol, least)
        self.t = problem.t0
        self.y = y0
        self.t_end = problem.t_end
        self.start_size = 1.0 + np.abs(y0).max(initial=0.0)
        self.stops = np.append(np.asarray(problem.samples, float), problem.t_end)
        self.unproven_step = min(problem.max_unproven, (self.t_end - self.t) / UNPROVEN_PARTS)
        self.h = 0.0
        self.steps = 0
        self.samples = []
        self.refusals = 0
        self.stiffness = StiffnessDetector(problem.t_end)
        self.stalls = StallDetector(problem.t0, problem.t_end - problem.t0)
        self.unproven = 0
        self.refused = 0
        self.events = None
        if problem.gaps is not None:
            self.events = EventFunctions(problem.gaps, problem.band, problem.armed, self.t, y0)

    def run(self, max_steps, first_step) -> Arc:
        """Integrate to the first event or to the end, with stops at the samples."""
        if not np.all(np.isfinite(self.fun(self.t, self.y))):
            return self._end(
                Status("nan", f"The right-hand side is not finite at t = {time_text(self.t)}.")
            )
        if self.events is not None and not self.events.finite:
            return self._end(
                Status("nan", f"A constraint is not finite at t = {time_text(self.t)}.")
            )
        solver = None
        h = first_step
        for k, stop in enumerate(self.stops):
            if stop > self.t:
                if solver is None or self.restart:
                    solver = self._new_stepper(self.t, self.y, stop, h)
                else:
                    solver.t_bound = stop
                    solver.status = "running"
            while self.t < stop:
                if self.steps >= max_steps:
                    return self._end(
                        Status(
                            "maxiter",
                            f"The last of max_steps was taken by t = {time_text(self.t)}.",
                        )
                    )
                if self.stalls(self.steps, self.t):
                    return self._end(Status("maxiter", STALL_MESSAGE.format(time_text(self.t))))
                status, fired, solver = self._step(solver)
                h = None if self.restart else solver.h_abs
                if not status.ok or fired.size:
                    return self._end(status, fired)
            if k < len(self.stops) - 1:
                self.samples.append(self.y.copy())
        return self._end(Status())

    def _end(self, status, fired=()):
        samples = np.array(self.samples).reshape(len(self.samples), self.y.size)
        return Arc(
            self.t,
            self.y,
            np.array(fired, np.int64),
            samples,
            status,
            self.steps,
            self.fun.calls,
            self.h,
            self.unproven,
            self.refused,
            0 if self.events is None else self.events.touches,
        )

    def _new_stepper(self, t, y, stop, first_step=None):
        """Return a stepper from (t, y) to `stop`."""
        kwargs = {} if first_step is None else {"first_step": min(first_step, stop - t)}
        solver = self.stepper(
            self.fun, t, y, stop, rtol=self.rtol, atol=self.atol, max_step=self.max_step, **kwargs
        )
        # SciPy's guess of the first step divides by norms that may overflow
        if not self.restart and not np.isfinite(solver.h_abs):
            solver.h_abs = 1e-6 * (stop - t)
        return solver

    def _step(self, solver):
        """Take one step; return its status, the functions that fired, and the stepper to go on."""
        t_old = self.t
        y_old = self.y
        wish = None if self.restart else solver.h_abs
        why = take_step(solver)
        self.steps += 1
        if why is not None or not np.all(np.isfinite(solver.y)):
            return self._failure(t_old, y_old), (), solver
        dense = solver.dense_output()
        pieces = split_where_smooth(dense, t_old, solver.t, self.data)
        shorter = self._shorter_step(dense, pieces, t_old, solver.t)
        if shorter is not None:
            return Status(), np.empty(0), self._refuse(solver, t_old, y_old, shorter)
        self.refusals = 0
        self.h = max(self.h, solver.t - t_old)
        self.unproven += pieces is None or not all(p.proven for p in pieces)
        if self.events is not None:
            found = self.events.first(dense, pieces or [single_piece(dense, t_old, solver.t)])
            if found is not None:
                return *self._land(t_old, y_old, *found), solver
        self.t = solver.t
        self.y = solver.y
        stages = self.integrator.end_stages
        if stages is not None and self.stiffness(solver, stages, t_old, y_old):
            return Status(), np.empty(0), self._switch_to_implicit(solver)
        # the step was cut short by a sample, not by its error
        if wish is not None and solver.status == "finished" and solver.step_size < wish:
            solver.h_abs = max(solver.h_abs, wish)
        self._project(solver)
        return Status(), np.empty(0), solver

    def _project(self, solver):
        """Project the state onto the invariant; a multistep method only where it restarts."""
        if self.project is None or (self.restart and solver.status != "finished"):
            return
        y = self.project(self.t, self.y)
        if y is not None:
            self.y = y
            solver.y = y
            if not self.restart:
                solver.f = self.fun(self.t, y)

    def _shorter_step(self, dense, pieces, a, b):
        """Return a shorter step if this one may have missed something, else None."""
        if self.refusals >= MAX_REFUSALS or b - a <= 64 * np.spacing(max(abs(a), abs(b))):
            return None
        if pieces is None:
            self.max_step = min(self.max_step, self.unproven_step)
            if b - a > 1.001 * self.unproven_step:
                return self.unproven_step
            pieces = [single_piece(dense, a, b)]
        elif len(pieces) == 1:
            return None  # proven smooth over the whole step: its estimate can be trusted
        return shorter_step(self.fun, pieces, self.integrator, self.atol, self.rtol, STEP_SHARE)

    def _refuse(self, solver, t, y, h):
        """Return a stepper at the start of the refused step, with first step h."""
        self.refusals += 1
        self.refused += 1
        stop = solver.t_bound
        if self.restart:
            fresh = self._new_stepper(t, y, stop, None)
            fresh.max_step = h
            return fresh
        return self._new_stepper(t, y, stop, h)

    def _switch_to_implicit(self, solver):
        """Return an implicit stepper from the present state."""
        self.integrator = INTEGRATORS[STIFF_INTEGRATOR]
        self.stepper = self.integrator.load()
        if self.project is not None:
            y = self.project(self.t, self.y)
            self.y = self.y if y is None else y
        stop = solver.t_bound if self.t < solver.t_bound else self.t_end
        return self._new_stepper(self.t, self.y, stop)

    def _failure(self, t, y) -> Status:
        """Return the status of a step from (t, y) that failed."""
        return failed_step(self.fun, t, y, self.t_end, self.start_size)

    def _land(self, t_old, y_old, t, i, slope):
        """Repeat the step with its end at the event; return its status and the function that fired.

        Two Newton corrections of the time on the repeated step.
        """
        width = t - t_old
        y = self._repeat(t_old, y_old, t)
        for _ in range(2):
            if y is None or slope >= 0.0:
                break
            g = float(self.events.gaps(t, y)[i]) - self.events.level[i]
            move = -g / slope
            if not (
                abs(move) <= 1e-3 * width
                and abs(move) > 2 * np.spacing(abs(t))
                and t + move <= self.t_end
            ):
                break
            again = self._repeat(t_old, y_old, t + move)
            if again is None or not abs(
                self.events.gaps(t + move, again)[i] - self.events.level[i]
            ) < abs(g):
                break
            t = t + move
            y = again
        if y is None:
            return self._failure(t_old, y_old), ()
        if self.project is not None:
            better = self.project(t, y)
            y = y if better is None else better
        self.t = t
        self.y = y
        return Status(), np.array([i])

    def _repeat(self, t_old, y_old, t):
        """Return the state at t, from (t_old, y_old) in one step if its error allows it."""
        if t - t_old <= 4 * np.spacing(max(abs(t), abs(t_old))):
            return y_old + (t - t_old) * self.fun(t_old, y_old)
        solver = self._new_stepper(t_old, y_old, t, t - t_old)
        while solver.status == "running":
            if take_step(solver) is not None or not np.all(np.isfinite(solver.y)):
                return None
        return solver.y
