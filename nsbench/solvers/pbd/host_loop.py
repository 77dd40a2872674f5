"""Time loop of position-based dynamics in Python, for scenes with Smooth constraints.

It does the sweep of the compiled loops in the same order: Smooth constraints are projected on by
Newton's method for the nearest point of {g_k >= 0}, the others by the kernel of the compiled loop,
run by run. Hard particles are taken over all pairs.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from nsbench.case import Case
from nsbench.dynamics.contacts.candidates import CandidateContacts
from nsbench.dynamics.contacts.constraint_set import SMOOTH, ConstraintSet
from nsbench.dynamics.contacts.kernels.contact_arrays import AffineRows
from nsbench.dynamics.contacts.time_dependence import SmoothRows
from nsbench.solvers.base import Grid
from nsbench.solvers.pbd.sweep_order import constraint_keys

if TYPE_CHECKING:
    from nsbench.solvers.pbd.kernels.loop_result import LoopResult
    from nsbench.solvers.pbd.method import PBD

MAX_NEWTON = 30  # steps of one projection; what has not converged by then shows in the residuals


def prepare(method: PBD, case: Case, scene: ConstraintSet, g: Grid, x0: np.ndarray) -> Callable:
    """Return a function without arguments that integrates from x0 (n,) and returns a LoopResult.

    method: PBD, with its options; g: the grid.
    """
    near = scene.near(x0, np.inf, float(case.t[0]))
    keys = constraint_keys(scene, near, method.order, method.seed, x0)
    near = near.take(np.argsort(keys))
    sweep = _Sweep(scene, near)

    def march() -> LoopResult:
        with np.errstate(all="ignore"):  # an overflow ends the run, and is reported by its status
            return _march(case, g, sweep, method.sweeps, x0)

    return march


def _march(case, g, sweep, sweeps, x0):
    """Integrate by explicit Euler with `sweeps` sweeps per step."""
    from nsbench.compilation.factories import as_numpy
    from nsbench.solvers.common.kernels.step_code import StepCode, all_finite
    from nsbench.solvers.pbd.kernels.loop_result import LoopResult

    f = as_numpy(case.problem.drift)
    X = np.full((len(g.t), case.n), np.nan)
    R = np.full((len(g.t), case.n), np.nan)
    x = x0.copy()
    reaction = np.zeros(case.n)
    sweep.reset()
    X[0] = x
    R[0] = reaction
    ids = []
    values = []
    for k in range(len(g.t) - 1):
        h = (g.t[k + 1] - g.t[k]) / g.substeps[k]
        for s in range(g.substeps[k]):
            now = g.t[k] + s * h
            after = g.t[k] + (s + 1) * h
            y = x + h * np.asarray(f(now, x), float)
            if not all_finite(y):
                end = sweep.work, StepCode.NAN, now, -1, -1
                return LoopResult(X, R, _ids(ids), np.array(values), *end)
            x = y.copy()
            for _ in range(sweeps):
                sweep.project(after, x)
            reaction = reaction + (x - y)
        X[k + 1] = x
        R[k + 1] = reaction
        near = sweep.near
        for c in np.flatnonzero(sweep.mu):
            ids.append((k + 1, near.family[c], near.i[c], near.j[c]))
            values.append(sweep.mu[c])
        sweep.mu[:] = 0.0
    code = StepCode.TIED if sweep.tied else StepCode.OK
    return LoopResult(X, R, _ids(ids), np.array(values), sweep.work, code, g.t[-1], -1, -1)


def _ids(ids):
    return np.array(ids, np.int64).reshape(-1, 4)


class _Sweep:
    """The sweep over all constraints in their order, and what it has done.

    mu (m,): impulses since the last sample; work: projections; tied: whether centres coincided.
    """

    def __init__(self, scene: ConstraintSet, near: CandidateContacts):
        self.scene = scene
        self.near = near
        self.runs = _runs(near.kind)
        self.reset()

    def reset(self) -> None:
        """Clear what was done, for a new run."""
        self.mu = np.zeros(len(self.near))
        self.work = 0
        self.tied = False

    def project(self, t: float, x: np.ndarray) -> None:
        """Project x (n,) once on every constraint at the time t."""
        from nsbench.solvers.pbd.kernels.projection import sweep

        scene = self.scene
        near = self.near
        lists = near.arrays()
        rows = AffineRows(scene.ptr, scene.cols, scene.vals, scene.inv2)
        b = scene.b(t)
        anchors = scene.anchors(t)
        for first, end, smooth in self.runs:
            if smooth:
                for c in range(first, end):
                    m = project_smooth(scene.smooth(near.q[c]), int(near.p[c]), t, x)
                    self.mu[c] += m
                    self.work += m > 0.0
            else:
                done, tied = sweep(first, end, lists, x, rows, b, anchors, self.mu)
                self.work += done
                self.tied = self.tied or tied


def _runs(kind):
    """Return maximal runs of entries that are all smooth or all not: (first, end, smooth)."""
    cut = np.flatnonzero(np.diff((kind == SMOOTH).astype(int))) + 1
    edges = [0, *cut.tolist(), len(kind)]
    return [(a, b, bool(kind[a] == SMOOTH)) for a, b in itertools.pairwise(edges) if b > a]


def project_smooth(rows: SmoothRows, k: int, t: float, x: np.ndarray) -> float:
    """Move x (n,) to the nearest point y of {g_k >= 0}; returns m >= 0.

    Solves y - x = m grad g(y), g(y) = 0 by Newton's method for m, with the gradient at the newest
    point; the first step is the projection on the tangent plane. rows: a Smooth family, evaluated.
    """
    y = x.copy()
    m = 0.0
    for _ in range(MAX_NEWTON):
        g = rows.g(t, y)[k]
        if m == 0.0 and g >= 0.0:
            return 0.0
        grad = rows.gradient(t, y)[k]
        size = float(grad @ grad)
        if size == 0.0 or not np.isfinite(size):
            break  # no normal: the violation stays, and shows in the residuals
        step = -g / size
        m = max(0.0, m + step)
        new = x + m * grad
        done = float(np.abs(new - y).max()) <= 1e-15 * (1.0 + float(np.abs(y).max()))
        y = new
        if done:
            break
    x[:] = y
    return m
