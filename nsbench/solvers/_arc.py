"""Follow a smooth differential equation up to the first of several events.

SciPy's steppers do the steps. On every accepted step each event function is interpolated at Chebyshev nodes of the
dense output, and the step is bisected until the interpolants are resolved: a function that dips below zero and comes
back inside one step is found. The stepper then repeats the step with its end at the event, because the dense output
is of lower order than the step. Steps also end at the sample times, for the same reason.
"""
from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nsbench.trajectory import Status

DEGREE = 8          # of the interpolants: one more than the dense output of DOP853
DEPTH = 12          # bisections of a step before an event function counts as not smooth
METHODS = {"dop853": "DOP853", "rk45": "RK45", "radau": "Radau", "lsoda": "LSODA"}

_ANGLES = np.pi * np.arange(DEGREE + 1) / DEGREE
NODES = -np.cos(_ANGLES)
_VANDER = np.polynomial.chebyshev.chebvander(NODES, DEGREE)
_TO_COEFFICIENTS = np.linalg.inv(_VANDER)
_MINIMAL = 16 * np.finfo(float).eps        # tolerances below SciPy's own floor are raised to it


@dataclass
class Arc:
    """What `follow` returns.

    t, y: where it ended. fired: indices of the functions whose event that is, empty at t_end. samples (s, n) for the
    sample times it reached. status: ok, or why it stopped early. steps, calls (of rhs), h: the largest step.
    """
    t: float
    y: np.ndarray
    fired: np.ndarray
    samples: np.ndarray
    status: Status
    steps: int
    calls: int
    h: float


class _Counted:
    """rhs with a count of its calls."""
    def __init__(self, rhs):
        self.rhs, self.calls = rhs, 0

    def __call__(self, t, y):
        self.calls += 1
        return self.rhs(t, y)


def follow(rhs: Callable, t0: float, y0: np.ndarray, t_end: float, gaps: Callable | None = None, *,
           method: str = "dop853", rtol: float = 1e-12, atol: float | None = None, max_step: float = np.inf,
           project: Callable | None = None, armed: np.ndarray | None = None, band: float | np.ndarray = 0.0,
           samples: np.ndarray = (), max_steps: int = 1_000_000, first_step: float | None = None) -> Arc:
    """Integrate y' = rhs(t, y) from t0 to t_end or to the first event.

    gaps(t, y) -> (m,): positive before their event. An armed function fires when it crosses zero downward. One that
    is not armed (by default: at most `band` at the start) fires when it falls `band` below min(its start, 0), and is
    armed once it exceeds `band`: a function that starts at zero must not fire on rounding.
    project(t, y) -> y or None (nothing to do) removes the drift off an invariant after every step.
    samples: sorted times in (t0, t_end] to land on. max_step bounds the step.
    """
    with np.errstate(all="ignore"):
        return _Follower(rhs, float(t0), np.array(y0, float), float(t_end), gaps, method, rtol,
                         rtol if atol is None else atol, max_step, project, armed, band, samples).run(
                             max_steps, first_step)


class _Follower:
    def __init__(self, rhs, t0, y0, t_end, gaps, method, rtol, atol, max_step, project, armed, band, samples):
        import scipy.integrate
        self.kind = getattr(scipy.integrate, METHODS[method])
        self.restart = method == "lsoda"        # keeps a history that cannot be projected
        self.fun, self.project, self.max_step = _Counted(rhs), project, max_step
        self.rtol, self.atol = max(rtol, 100 * np.finfo(float).eps), max(atol, _MINIMAL)
        self.t, self.y, self.t_end, self.y_size = t0, y0, t_end, 1.0 + np.abs(y0).max(initial=0.0)
        self.gaps, self.stops = gaps, np.append(np.asarray(samples, float), t_end)
        self.h, self.steps, self.rows = 0.0, 0, []
        if gaps is not None:
            g = np.asarray(gaps(t0, y0), float)
            self.band = np.broadcast_to(np.asarray(band, float), g.shape)
            self.armed = g > self.band if armed is None else np.array(armed, bool)
            self.level = np.where(self.armed, 0.0, np.minimum(g, 0.0) - self.band)

    def run(self, max_steps, first_step) -> Arc:
        if not np.all(np.isfinite(self.fun(self.t, self.y))):
            return self._end(Status("nan", f"The right-hand side is not finite at t = {self.t:.9g}."))
        if self.gaps is not None and not np.all(np.isfinite(self.gaps(self.t, self.y))):
            return self._end(Status("nan", f"A constraint is not finite at t = {self.t:.9g}."))
        solver, h = None, first_step
        for k, stop in enumerate(self.stops):
            if stop > self.t:
                if solver is None or self.restart:
                    solver = self._solver(self.t, self.y, stop, h)
                else:
                    solver.t_bound, solver.status = stop, "running"
            while self.t < stop:
                if self.steps >= max_steps:
                    return self._end(Status("maxiter", f"{max_steps} steps were taken by t = {self.t:.9g}."))
                status, fired = self._step(solver)
                h = None if self.restart else solver.h_abs
                if not status.ok or fired.size:
                    return self._end(status, fired)
            if k < len(self.stops) - 1:
                self.rows.append(self.y.copy())
        return self._end(Status())

    def _end(self, status, fired=()):
        rows = np.array(self.rows).reshape(len(self.rows), self.y.size)
        return Arc(self.t, self.y, np.array(fired, np.int64), rows, status, self.steps, self.fun.calls, self.h)

    def _solver(self, t, y, stop, first_step=None):
        kwargs = {} if first_step is None else {"first_step": min(first_step, stop - t)}
        solver = self.kind(self.fun, t, y, stop, rtol=self.rtol, atol=self.atol, max_step=self.max_step, **kwargs)
        if not self.restart and not np.isfinite(solver.h_abs):
            solver.h_abs = 1e-6 * (stop - t)    # the guess of the first step divides by norms that may overflow
        return solver

    def _step(self, solver):
        """One step; its status and the functions that fired in it."""
        t_old, y_old = self.t, self.y
        wish = None if self.restart else solver.h_abs
        why = _advance(solver)
        self.steps += 1
        if why is not None or not np.all(np.isfinite(solver.y)):
            return self._failed(t_old, y_old), ()
        self.h = max(self.h, solver.t - t_old)
        if self.gaps is not None:
            found = self._first_event(solver.dense_output(), t_old, solver.t)
            if found is not None:
                return self._land(t_old, y_old, *found)
        self.t, self.y = solver.t, solver.y
        if wish is not None and solver.status == "finished" and solver.step_size < wish:
            solver.h_abs = max(solver.h_abs, wish)          # the step was cut short by a sample, not by its error
        if self.project is not None and (not self.restart or solver.status == "finished"):
            y = self.project(self.t, self.y)
            if y is not None:
                self.y = solver.y = y
                if not self.restart:
                    solver.f = self.fun(self.t, y)
        return Status(), np.empty(0)

    def _failed(self, t, y) -> Status:
        if np.abs(y).max(initial=0.0) > 1e6 * self.y_size:
            return Status("diverged", f"The state grew to {np.abs(y).max():.3g} at t = {t:.9g}.")
        ahead = t + 1e-9 * (self.t_end - t)
        if not np.all(np.isfinite(self.fun(ahead, y + (ahead - t) * self.fun(t, y)))):
            return Status("nan", f"The right-hand side is not finite after t = {t:.9g}.")
        return Status("degenerate", f"The step size fell below rounding at t = {t:.9g}: the solution is not smooth, "
                                    "or the equation too stiff for this method.")

    def _first_event(self, dense, a, b):
        """(time, fired index, slope) of the first event on [a, b], or None; arms what rose above its band."""
        pieces = [(a, b, 0)]
        while pieces:
            lo, hi, depth = pieces.pop()
            times = 0.5 * (lo + hi) + 0.5 * (hi - lo) * NODES
            times[0], times[-1] = lo, hi
            values = np.array([self.gaps(s, y) for s, y in zip(times, dense(times).T, strict=True)])
            below = np.flatnonzero(values[0] <= self.level)
            if below.size:
                return lo, below[0], 0.0
            c = _TO_COEFFICIENTS @ values - np.eye(DEGREE + 1, 1) * self.level
            tail = np.abs(c[-2:]).sum(axis=0)
            swing = np.abs(c[1:]).sum(axis=0)
            near = ~(c[0] - swing - tail > 0.0)
            rough = near & (tail > 1e-4 * swing) & (tail > 1e-3 * self.band) & (swing > 1e-15 * np.abs(values).max())
            if rough.any() and depth < DEPTH:
                mid = 0.5 * (lo + hi)
                pieces += [(mid, hi, depth + 1), (lo, mid, depth + 1)]
                continue
            hits = [(*_first_root(c[:, i], values[:, i] - self.level[i]), i) for i in np.flatnonzero(near)]
            hits = [(s, i, left, right) for s, left, right, i in hits if s is not None]
            if hits:
                s, i, left, right = min(hits)
                to_time = lambda u: 0.5 * (lo + hi) + 0.5 * (hi - lo) * u       # noqa: B023 (used at once)
                slope = np.polynomial.chebyshev.chebval(s, np.polynomial.chebyshev.chebder(c[:, i])) * 2 / (hi - lo)
                return self._root(dense, i, to_time(left), to_time(s), to_time(right)), i, float(slope)
            rose = ~self.armed & (values[-1] > self.band)
            self.armed |= rose
            self.level[rose] = 0.0
        return None

    def _root(self, dense, i, left, guess, right):
        from scipy.optimize import brentq
        fun = lambda s: float(self.gaps(s, dense(s))[i]) - self.level[i]
        if not (left < right and fun(left) > 0.0 and fun(right) < 0.0):
            return guess
        # a root of higher order takes more than the usual hundred iterations
        return brentq(fun, left, right, xtol=4 * np.spacing(abs(right)), rtol=_MINIMAL, maxiter=10_000)

    def _land(self, t_old, y_old, t, i, slope):
        """Repeat the step with its end at the event; two Newton corrections of its time on the repeated step."""
        width = t - t_old
        y = self._repeat(t_old, y_old, t)
        for _ in range(2):
            if y is None or slope >= 0.0:
                break
            g = float(self.gaps(t, y)[i]) - self.level[i]
            move = -g / slope
            if not (abs(move) <= 1e-3 * width and abs(move) > 2 * np.spacing(abs(t)) and t + move <= self.t_end):
                break
            again = self._repeat(t_old, y_old, t + move)
            if again is None or not abs(self.gaps(t + move, again)[i] - self.level[i]) < abs(g):
                break
            t, y = t + move, again
        if y is None:
            return self._failed(t_old, y_old), ()
        if self.project is not None:
            better = self.project(t, y)
            y = y if better is None else better
        self.t, self.y = t, y
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
    """One step of a SciPy stepper; None, or why it failed. Its linear algebra raises on values that are not finite."""
    try:
        why = solver.step()
    except (ValueError, np.linalg.LinAlgError) as e:
        return str(e)
    return (why or "failed") if solver.status == "failed" else None


def _first_root(c, values):
    """First downward crossing of the Chebyshev series c on [-1, 1], with a point on either side; (None, 0, 0) if none.

    values: the function at NODES, to find a crossing where the series is not resolved.
    """
    c = np.trim_zeros(c, "b")
    roots = np.polynomial.chebyshev.chebroots(c) if len(c) > 1 else np.empty(0)
    roots = np.sort(roots.real[(roots.imag == 0.0) & (np.abs(roots.real) <= 1.0 + 1e-12)]).clip(-1.0, 1.0)
    edges = np.concatenate([[-1.0], roots, [1.0]])
    middle = 0.5 * (edges[1:] + edges[:-1])
    sign = np.polynomial.chebyshev.chebval(middle, c)
    for k in range(len(roots)):
        if sign[k + 1] < 0.0 and roots[k] < 1.0:
            return float(roots[k]), float(middle[k]), float(middle[k + 1])
    negative = np.flatnonzero(values < 0.0)
    if negative.size and negative[0] > 0:
        k = negative[0]
        return float(NODES[k]), float(NODES[k - 1]), float(NODES[k])
    return None, 0.0, 0.0
