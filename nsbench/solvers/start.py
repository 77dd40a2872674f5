"""What an infeasible start means: an error, the nearest feasible point, or itself, as the case says."""
from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.contacts import ANCHOR, PAIR, Scene

ITERATIONS = 1000         # linear convergence: a start that overlaps deeply needs a few hundred
TOLERANCE = 1e-9          # relative; a start that misses by less is the rounding of whoever made it


class NoStart(ValueError):
    """There is no start; code: the status of the runs that would begin there."""

    def __init__(self, code: str, sentence: str):
        super().__init__(sentence)
        self.code = code


def start_state(case: Case, scene: Scene) -> np.ndarray:
    """(n,) the start under the case's policy.

    "error": ValueError with the worst constraint and by how much; "keep": x0 as it is; "project": the nearest
    feasible point around, by sequential least-distance problems (linearised constraints, until nothing moves any more);
    ValueError where none is nearest (coincident centres) or it is not found.
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
    """The point where linearising the constraints gives the point itself; it stays feasible and nearest from there on."""
    from scipy.optimize import nnls
    y, moved = x0, np.inf
    for _ in range(ITERATIONS):
        near = scene.near(y, float(np.abs(y - x0).max()) + scale, t)
        g = scene.gaps(t, y, near)
        if g.min() >= -1e-13 * scale and moved <= 1e-13 * scale:
            return y
        tie = np.flatnonzero(np.isin(near.kind, (PAIR, ANCHOR)) & (g == -near.sign * near.d) & (near.sign > 0.0))
        if tie.size:
            raise NoStart("degenerate", f"the start of {case.key} has coincident centres, {near.ids[int(tie[0])]}: no feasible "
                                        'point is the nearest; part them, or give start="keep"')
        G = scene.dense_gradients(t, y, near)
        # least distance: min |z - x0|, G z >= h; by non-negative least squares (Lawson & Hanson 1974, chapter 23)
        h = G @ (y - x0) - g
        E, rhs = np.vstack([G.T, h[None]]), np.append(np.zeros(len(x0)), 1.0)
        mu, size = nnls(E, rhs)
        if size < 1e-12:
            raise NoStart("infeasible", f"the constraints of {case.key} leave no point: the start cannot be projected")
        r = E @ mu - rhs
        z = x0 - r[:-1] / r[-1]
        y, moved = z, float(np.abs(z - y).max())
    raise ValueError(f"the start of {case.key} could not be projected in {ITERATIONS} steps (violation {-g.min():.3g}, "
                     f"last step {moved:.3g}): the nearest feasible point is perhaps not unique")
