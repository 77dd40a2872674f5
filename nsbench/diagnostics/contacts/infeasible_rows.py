"""Prove linear constraints A x + b >= 0 infeasible by a linear program, for the check on them.

Phase I of Boyd & Vandenberghe, Convex Optimization, section 11.4.1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.case import Case
from nsbench.case.scale import size_text, time_text
from nsbench.dynamics.contacts.constraint_set import ROW
from nsbench.dynamics.contacts.tolerances import scene_of, tolerances

SOLVED = 1e-10  # of the farthest constraint looked at: what a linear program is solved to
# of the depth, or of what is violated next: constraints farther away are asked when in the way
FAR = 1e4
ROOM = 1e3  # of the depth: the margin that is looked for, for the point to serve at other times too
KEPT = 16  # points that were found
# programs solved for one run, and their entries: without room between walls each sample asks for
# one
MOST = 400
ENTRIES = 2e6
WEIGHS = 1e-7  # of all weights: a constraint that takes part in a contradiction


@dataclass(frozen=True)
class Infeasibility:
    """What every d misses A d + g >= 0 by, in lengths: `least`, 0.0 where none or not known;
    `deep`, the most that those which contradict each other are violated by at d = 0; way (n,), a d
    that misses none, where one was found."""

    least: float = 0.0
    deep: float = 0.0
    way: np.ndarray | None = None


class RowFeasibility:
    """The affine rows of a case, asked at many times: a point that was found serves as long as it
    misses none."""

    def __init__(self, case: Case):
        self.case, self.scene, self.found, self.programs = case, scene_of(case), [], 0
        listed = self.scene.all_static()
        self.near = listed.take(listed.kind == ROW)

    def contradiction(self, t: float, x: np.ndarray) -> str | None:
        """Why no state meets all rows at t; None where some does. x (n,): a state around."""
        s = self.scene
        if len(s.ptr) < 3 or self.programs > MOST or self.programs * len(s.vals) > ENTRIES:
            return None
        b = s.b(t)
        rows = lambda z: np.add.reduceat(s.vals * z[s.cols], s.ptr[:-1]) + b
        if any(
            (rows(x + z if moves else z) >= 0.0).all() for moves, z in ((True, 0.0), *self.found)
        ):
            return None
        g = rows(x)
        allowed = tolerances(self.case, s, t, x, self.near)
        if (g >= -allowed).all():
            return None
        self.programs += 1
        miss = phase_one(s.ptr, s.cols, s.vals, g, s.n, allowed, ROOM)
        if miss.way is not None:
            self.found = [(True, miss.way), (False, x + miss.way), *self.found][:KEPT]
        if not miss.least > 0.0:
            return None
        return (
            f"The walls contradict each other at t = {time_text(t, 6)}: every state misses one of "
            "them "
            f"by {size_text(miss.least)} or more."
        )


def phase_one(
    ptr: np.ndarray,
    cols: np.ndarray,
    vals: np.ndarray,
    g: np.ndarray,
    n: int,
    allowed: np.ndarray,
    room: float = 0.0,
) -> Infeasibility:
    """The least s with A d + g + s >= 0 for some d, by rows made as long as one: A as CSR; g (m,),
    which may miss by `allowed`.

    Of rows beyond FAR times the largest -g nothing is asked until the way found misses them. With
    `room` a d is looked for that keeps so many times the largest -g clear of every row.
    """
    rows = np.repeat(np.arange(len(g)), np.diff(ptr))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        norm = 1.0 / np.sqrt(np.bincount(rows, vals * vals, len(g)))
        asks = np.isfinite(norm) & (
            norm > 0.0
        )  # a row of zeros, or of no numbers, asks nothing of a state
        g = np.where(asks, g * norm, np.inf)
        allowed = np.where(asks, allowed * norm, 0.0)
        norm = np.where(asks, norm, 0.0)
    deep = float(-np.min(g, initial=0.0))
    if not 0.0 < deep < np.inf or np.isnan(g).any():
        return Infeasibility()
    with np.errstate(invalid="ignore"):
        use = g <= FAR * deep
        vals = np.where(asks[rows], vals * norm[rows], 0.0)
    while True:
        s, d, weights = _program(ptr, cols, vals, g, n, use, room * deep)
        if d is None:
            return Infeasibility()
        part = weights > WEIGHS
        least = 10.0 * SOLVED * float(np.abs(g[use]).max()) + float(weights[part] @ allowed[part])
        if s > least:
            return Infeasibility(s, float(-np.min(g[part], initial=0.0)))
        after = np.bincount(rows, vals * d[cols], len(g)) + g
        if (after >= 0.0).all():
            return Infeasibility(way=d)
        new = (after < 0.0) & ~use
        if not new.any():
            return Infeasibility()
        use |= new & (g <= FAR * float(g[new].min()))


def _program(ptr, cols, vals, g, n, use, room) -> tuple:
    """s >= -room, d (n,) or None, and the weights (m,) of the rows that keep s from being less."""
    from scipy.optimize import linprog
    from scipy.sparse import csr_matrix, hstack

    at = np.flatnonzero(use)
    A = csr_matrix((vals, cols, ptr), (len(g), n))[at]
    unit = float(np.abs(g[at]).max())
    found = linprog(
        np.append(np.zeros(n), 1.0),
        A_ub=-hstack([A, np.ones((len(at), 1))]).tocsr(),
        b_ub=g[at] / unit,
        bounds=[(None, None)] * n + [(-room / unit, None)],
        options={"primal_feasibility_tolerance": SOLVED, "dual_feasibility_tolerance": SOLVED},
    )
    if found.status:
        return 0.0, None, None
    weights = np.zeros(len(g))
    weights[at] = -found.ineqlin.marginals
    return unit * float(found.x[-1]), unit * found.x[:-1], weights
