"""Follow a smooth differential equation up to the first of several events.

SciPy's steppers do the steps. Every accepted step is cut into pieces on which the functions of the
case are proven to be smooth (see _pieces), and events are roots of interpolants on the pieces (see
_crossings). Where a proof fails for the way a function is written, the equation is tested at more
points and steps are bounded. A step that did not see what the drift does is refused: on the pieces
that needed halving the path must satisfy the equation.

The stepper repeats a step with its end at the event, because the dense output is of lower order
than the step. Steps also end at the sample times, for the same reason.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nsbench.solvers.event_driven.smooth.crossings import EventFunctions
from nsbench.solvers.event_driven.smooth.defect import shorter
from nsbench.solvers.event_driven.smooth.pieces import single_piece, split_where_smooth
from nsbench.trajectory import Status

METHODS = {"dop853": "DOP853", "rk45": "RK45", "radau": "Radau", "lsoda": "LSODA"}
# of the tolerance goes to one step: a run takes tens, and kinks of a drift deceive estimates
SHARE = 0.03
REFUSALS = 40  # steps refused in a row, each shorter than the one before
PARTS = 64  # of the run: longest step where nothing is proven
# the equation is so much faster than the solution, in so many steps in a row, and
STIFF = 20.0
ROW = 15
LONG = 2000
#                         so many are still to come: an implicit method is faster (Hairer & Wanner
# 1996, section IV.2) so many steps that lead no further than this part of the arc: as many again as
# a run may take would
CREEP = 200
SPAN = 1e-9
#                         not end it (steps towards a kink or a dip 1e-10 wide shrink and grow by
# factors: 30 do)
CREEPS = (
    f"{CREEP} steps led from t = {{:.9g}} no further than {SPAN:g} of the run: a pole, contacts "
    f"that lock, or a layer too "
    "thin for doubles."
)
_MINIMAL = 16 * np.finfo(float).eps  # tolerances below SciPy's own floor are raised to it


@dataclass
class Arc:
    """What `follow` returns.

    t, y: where it ended. fired: indices of the functions whose event that is, empty at t_end.
    samples (s, n) for the sample times it reached. status: ok, or why it stopped early. steps,
    calls (of rhs), h: the largest step.
    unproven: steps with a part on which nothing is proven; refused: steps taken again; touches:
    dips that were none.
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


class _Counted:
    """rhs with a count of its calls."""

    def __init__(self, rhs):
        self.rhs = rhs
        self.calls = 0

    def __call__(self, t, y):
        self.calls += 1
        return self.rhs(t, y)


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
) -> Arc:
    """Integrate y' = rhs(t, y) from t0 to t_end or to the first event.

    gaps(t, y) -> (m,): positive before their event. An armed function fires when it crosses zero
    downward. One that is not armed (by default: at most `band` at the start) fires when it falls
    `band` below min(its start, 0), and is armed once it exceeds `band`: a function that starts at
    zero must not fire on rounding.
    project(t, y) -> y or None (nothing to do) removes the drift off an invariant after every step.
    samples: sorted times in (t0, t_end] to land on. max_step bounds the step. rtol, atol: error of
    the run that is aimed at; a step gets SHARE of it.
    data(t, y) -> sequence: the functions of the case that rhs and gaps are made of, written over
    arrays. They are called with Jets (see nsbench.solvers.event_driven.interval_taylor) to prove
    that nothing is missed between steps; None: nothing is proven.
    """
    with np.errstate(all="ignore"):
        return _Follower(
            rhs,
            float(t0),
            np.array(y0, float),
            float(t_end),
            gaps,
            method,
            rtol,
            rtol if atol is None else atol,
            max_step,
            project,
            armed,
            band,
            samples,
            data,
        ).run(max_steps, first_step)


class StallDetector:
    """Whether the last CREEP steps hardly moved, and as far as those before, or not at all:
    shrinking ones end by themselves."""

    def __init__(self, t0: float, length: float):
        self.mark = (0, t0, 0.0)
        self.length = length

    def __call__(self, steps: int, t: float) -> bool:
        """To be asked after every step, with the number of steps so far and the time."""
        begun, start, before = self.mark
        if steps - begun < CREEP:
            return False
        far = t - start
        self.mark = steps, t, far
        return (
            far == 0.0 or 0.05 * before < far < SPAN * self.length
        )  # LSODA goes on with steps below rounding


class _Follower:
    def __init__(
        self,
        rhs,
        t0,
        y0,
        t_end,
        gaps,
        method,
        rtol,
        atol,
        max_step,
        project,
        armed,
        band,
        samples,
        data,
    ):
        import scipy.integrate

        self.kind = getattr(scipy.integrate, METHODS[method])
        self.method = method
        self.slow = 0
        self.restart = method == "lsoda"  # keeps a history that cannot be projected
        self.fun = _Counted(rhs)
        self.project = project
        self.max_step = max_step
        self.data = data
        eps = np.finfo(float).eps
        # an impulse is what two states differ by: it cannot be asked for more digits than the
        # largest of them has
        least = np.maximum(
            _MINIMAL * np.minimum(1.0, atol / rtol), eps * np.abs(y0).max(initial=0.0)
        )
        self.rtol = max(SHARE * rtol, 100 * eps)
        self.atol = np.maximum(SHARE * atol, least)
        self.t, self.y, self.t_end, self.y_size = t0, y0, t_end, 1.0 + np.abs(y0).max(initial=0.0)
        self.stops = np.append(np.asarray(samples, float), t_end)
        self.bound = (t_end - t0) / PARTS
        self.h = 0.0
        self.steps = 0
        self.rows = []
        self.row = 0
        self.creeps = StallDetector(t0, t_end - t0)
        self.unproven = self.refused = 0
        self.watch = None if gaps is None else EventFunctions(gaps, band, armed, t0, y0)

    def run(self, max_steps, first_step) -> Arc:
        if not np.all(np.isfinite(self.fun(self.t, self.y))):
            return self._end(
                Status("nan", f"The right-hand side is not finite at t = {self.t:.9g}.")
            )
        if self.watch is not None and not self.watch.finite:
            return self._end(Status("nan", f"A constraint is not finite at t = {self.t:.9g}."))
        solver = None
        h = first_step
        for k, stop in enumerate(self.stops):
            if stop > self.t:
                if solver is None or self.restart:
                    solver = self._solver(self.t, self.y, stop, h)
                else:
                    solver.t_bound = stop
                    solver.status = "running"
            while self.t < stop:
                if self.steps >= max_steps:
                    return self._end(
                        Status("maxiter", f"The last of max_steps was taken by t = {self.t:.9g}.")
                    )
                if self.creeps(self.steps, self.t):
                    return self._end(Status("maxiter", CREEPS.format(self.t)))
                status, fired, solver = self._step(solver)
                h = None if self.restart else solver.h_abs
                if not status.ok or fired.size:
                    return self._end(status, fired)
            if k < len(self.stops) - 1:
                self.rows.append(self.y.copy())
        return self._end(Status())

    def _end(self, status, fired=()):
        rows = np.array(self.rows).reshape(len(self.rows), self.y.size)
        return Arc(
            self.t,
            self.y,
            np.array(fired, np.int64),
            rows,
            status,
            self.steps,
            self.fun.calls,
            self.h,
            self.unproven,
            self.refused,
            0 if self.watch is None else self.watch.touches,
        )

    def _solver(self, t, y, stop, first_step=None):
        kwargs = {} if first_step is None else {"first_step": min(first_step, stop - t)}
        solver = self.kind(
            self.fun, t, y, stop, rtol=self.rtol, atol=self.atol, max_step=self.max_step, **kwargs
        )
        if not self.restart and not np.isfinite(solver.h_abs):
            solver.h_abs = 1e-6 * (
                stop - t
            )  # the guess of the first step divides by norms that may overflow
        return solver

    def _step(self, solver):
        """One step; its status, the functions that fired in it, and the stepper to go on with."""
        t_old = self.t
        y_old = self.y
        wish = None if self.restart else solver.h_abs
        why = _advance(solver)
        self.steps += 1
        if why is not None or not np.all(np.isfinite(solver.y)):
            return self._failed(t_old, y_old), (), solver
        dense = solver.dense_output()
        pieces = split_where_smooth(dense, t_old, solver.t, self.data)
        shorter = self._unseen(dense, pieces, t_old, solver.t)
        if shorter is not None:
            return Status(), np.empty(0), self._again(solver, t_old, y_old, shorter)
        self.row = 0
        self.h = max(self.h, solver.t - t_old)
        self.unproven += pieces is None or not all(p.proven for p in pieces)
        if self.watch is not None:
            found = self.watch.first(dense, pieces or [single_piece(dense, t_old, solver.t)])
            if found is not None:
                return *self._land(t_old, y_old, *found), solver
        self.t = solver.t
        self.y = solver.y
        if self.method == "dop853" and self._stiff(solver, t_old, y_old):
            return Status(), np.empty(0), self._implicit(solver)
        if wish is not None and solver.status == "finished" and solver.step_size < wish:
            solver.h_abs = max(
                solver.h_abs, wish
            )  # the step was cut short by a sample, not by its error
        if self.project is not None and (not self.restart or solver.status == "finished"):
            y = self.project(self.t, self.y)
            if y is not None:
                self.y = solver.y = y
                if not self.restart:
                    solver.f = self.fun(self.t, y)
        return Status(), np.empty(0), solver

    def _unseen(self, dense, pieces, a, b):
        """A shorter step, if this one went past something: None if it may stand."""
        if self.row >= REFUSALS or b - a <= 64 * np.spacing(max(abs(a), abs(b))):
            return None
        if pieces is None:
            self.max_step = min(self.max_step, self.bound)
            if b - a > 1.001 * self.bound:
                return self.bound
            pieces = [single_piece(dense, a, b)]
        elif len(pieces) == 1:
            return None  # proven smooth over the whole step: its estimate can be trusted
        return shorter(self.fun, pieces, self.method, self.atol, self.rtol, SHARE)

    def _again(self, solver, t, y, h):
        """A stepper at the start of the refused step, with first step h."""
        self.row += 1
        self.refused += 1
        stop = solver.t_bound
        if self.restart:
            fresh = self._solver(t, y, stop, None)
            fresh.max_step = h
            return fresh
        return self._solver(t, y, stop, h)

    def _stiff(self, solver, t, y) -> bool:
        """Whether the equation bounds the steps and not the solution: from the two stages at the
        end of the step."""
        h = solver.t - t
        stage = y + h * (solver.A[11, :11] @ solver.K[:11])
        fast = np.linalg.norm(solver.K[12] - solver.K[11]) / np.linalg.norm(solver.y - stage)
        slow = np.linalg.norm(solver.K[12] - solver.K[0]) / (
            h * max(np.linalg.norm(solver.K[12]), np.linalg.norm(solver.K[0]))
        )
        self.slow = (
            self.slow + 1 if fast > STIFF * slow and np.isfinite(fast) else max(self.slow - 1, 0)
        )
        return self.slow >= ROW and self.t_end - solver.t > LONG * h

    def _implicit(self, solver):
        """Go on from here with an implicit method."""
        import scipy.integrate

        self.kind = scipy.integrate.Radau
        self.method = "radau"
        if self.project is not None:
            y = self.project(self.t, self.y)
            self.y = self.y if y is None else y
        return (
            self._solver(self.t, self.y, solver.t_bound)
            if self.t < solver.t_bound
            else self._solver(self.t, self.y, self.t_end)
        )

    def _failed(self, t, y) -> Status:
        if np.abs(y).max(initial=0.0) > 1e6 * self.y_size:
            return Status("diverged", f"The state grew to {np.abs(y).max():.3g} at t = {t:.9g}.")
        ahead = t + 1e-9 * (self.t_end - t)
        if not np.all(np.isfinite(self.fun(ahead, y + (ahead - t) * self.fun(t, y)))):
            return Status("nan", f"The right-hand side is not finite after t = {t:.9g}.")
        return Status(
            "degenerate",
            f"The step size fell below rounding at t = {t:.9g}: the solution is not smooth, "
            "or the equation too stiff for this method.",
        )

    def _land(self, t_old, y_old, t, i, slope):
        """Repeat the step with its end at the event; two Newton corrections of its time on the
        repeated step."""
        width = t - t_old
        y = self._repeat(t_old, y_old, t)
        for _ in range(2):
            if y is None or slope >= 0.0:
                break
            g = float(self.watch.gaps(t, y)[i]) - self.watch.level[i]
            move = -g / slope
            if not (
                abs(move) <= 1e-3 * width
                and abs(move) > 2 * np.spacing(abs(t))
                and t + move <= self.t_end
            ):
                break
            again = self._repeat(t_old, y_old, t + move)
            if again is None or not abs(
                self.watch.gaps(t + move, again)[i] - self.watch.level[i]
            ) < abs(g):
                break
            t = t + move
            y = again
        if y is None:
            return self._failed(t_old, y_old), ()
        if self.project is not None:
            better = self.project(t, y)
            y = y if better is None else better
        self.t = t
        self.y = y
        return Status(), np.array([i])

    def _repeat(self, t_old, y_old, t):
        if t - t_old <= 4 * np.spacing(max(abs(t), abs(t_old))):
            return y_old + (t - t_old) * self.fun(t_old, y_old)
        solver = self._solver(t_old, y_old, t, t - t_old)
        while solver.status == "running":
            if _advance(solver) is not None or not np.all(np.isfinite(solver.y)):
                return None
        return solver.y


def _advance(solver) -> str | None:
    """One step of a SciPy stepper; None, or why it failed. Its linear algebra raises on values that
    are not finite."""
    try:
        why = solver.step()
    except (ValueError, np.linalg.LinAlgError) as e:
        return str(e)
    return (why or "failed") if solver.status == "failed" else None
