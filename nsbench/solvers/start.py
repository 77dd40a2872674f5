"""What an infeasible start means: an error, the nearest feasible point, or itself, as the case says."""
from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.contacts import Scene

TOLERANCE = 1e-9          # relative; a start that misses by less is the rounding of whoever made it


def start_state(case: Case, scene: Scene) -> np.ndarray:
    """(n,) the start under the case's policy.

    "error": ValueError with the worst constraint and by how much; "keep": x0 as it is; "project": the nearest
    feasible point, by sequential least-distance problems (Gauss-Newton on the constraints).
    """
    x, t = case.x0.copy(), float(case.t[0])
    if case.start == "keep" or not scene.families:
        return x
    near = scene.near(x, 0.0, t)
    g = scene.gaps(t, x, near)
    scale = max(1.0, float(np.abs(x).max(initial=0.0)))
    if not g.size or g.min() >= -TOLERANCE * scale:
        return x
    if case.start == "error":
        worst = int(np.argmin(g))
        raise ValueError(f"the start of {case.key} violates constraint {near.ids[worst]} by {-g[worst]:.3g}; "
                         'give a feasible x0, or start="project" or "keep"')
    return _nearest(case, scene, x, t, scale)


def _nearest(case, scene, x0, t, scale):
    from scipy.optimize import nnls
    y = x0
    for _ in range(100):
        near = scene.near(y, float(np.abs(y - x0).max()) + scale, t)
        g = scene.gaps(t, y, near)
        if g.min() >= -1e-13 * scale and y is not x0:
            return y
        G = scene.dense_gradients(t, y, near)
        # least distance: min |z - x0|, G z >= h; by non-negative least squares (Lawson & Hanson 1974, chapter 23)
        h = G @ (y - x0) - g
        E, rhs = np.vstack([G.T, h[None]]), np.append(np.zeros(len(x0)), 1.0)
        _, size = nnls(E, rhs)
        r = E @ nnls(E, rhs)[0] - rhs
        if size < 1e-12:
            raise ValueError(f"the constraints of {case.key} leave no point: the start cannot be projected")
        y = x0 - r[:-1] / r[-1]
    raise ValueError(f"the start of {case.key} could not be projected in 100 steps (violation {-g.min():.3g})")
