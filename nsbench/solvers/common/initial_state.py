"""Start of a run under the policy of its case: infeasible starts are errors, projected or kept.

The projection is the nearest feasible point, found by sequential least-distance problems:

    y <- x0 + argmin |d|^2    subject to    g(y) + grad g(y) . (x0 + d - y) >= 0
"""

from __future__ import annotations

import functools

import numpy as np

from nsbench.case import Case
from nsbench.case.scale import size_text
from nsbench.dynamics.contacts.constraint_set import ANCHOR, PAIR, ConstraintSet
from nsbench.dynamics.contacts.tolerances import PRINTED, scene_of, term_sizes, tolerances, violates
from nsbench.problem import Affine, Distance
from nsbench.qp.projection import least_distance

ITERATIONS = 1000  # linear convergence: a start that overlaps deeply needs a few hundred
# constraints that are looked at, and times what is missed, of a start that misses by digits
LISTED = 3000
FARTHER = 100.0
# of a coordinate, the longest way, or what pushes is made of: what moves by less may have ended
STILL = 1e-13
REMAINS = 1e-3  # times STILL: of all further moves, whose ratio is that of the last two
TINY = np.finfo(float).tiny


class InfeasibleStart(ValueError):
    """No start exists; code: the status of the runs that would begin there."""

    def __init__(self, code: str, sentence: str):
        super().__init__(sentence)
        self.code = code


def initial_state(case: Case, scene: ConstraintSet) -> np.ndarray:
    """Return the start (n,) under the policy of the case.

    "error": ValueError with the worst constraint and by how much; "keep": x0 as it is; "project":
    the nearest feasible point around, by sequential least-distance problems (linearised
    constraints, until nothing moves any more);
    ValueError where none is nearest (coincident centres) or it is not found. A start that misses by
    no more than the last of its printed digits is no error, and is projected too, so that no method
    makes a push of it, if what is feasible is near.
    """
    x = case.x0.copy()
    t = float(case.t[0])
    if case.start == "keep" or not scene.families:
        return x
    near = scene.near(x, 0.0, t)
    g = scene.gaps(t, x, near)
    if (g >= 0.0).all():
        return x
    far = violates(case, scene, t, x)
    tidied = None if far else _project_small_violation(case)
    if tidied is not None:
        return tidied.copy()
    if case.start == "error" or not (g > -np.inf).all():
        worst = int(np.argmin(np.where(np.isnan(g), -np.inf, g)))
        beyond = "" if far else ", and what is feasible is much farther away"
        raise ValueError(
            f"the start of {case.key} violates constraint {near.ids[worst]} by "
            f"{size_text(-g[worst])}{beyond}; "
            'give a feasible x0, or start="project" or "keep"'
        )
    return _project_start(case, scene, x, t)


@functools.lru_cache(maxsize=64)
def _project_small_violation(case: Case) -> np.ndarray | None:
    """The start, which misses by the last of its digits, projected; itself if it misses by rounding
    or by very many constraints, or no point is nearest: it is a start all the same; None if it were
    moved by much more than all that it misses by."""
    scene = scene_of(case)
    x = case.x0.copy()
    t = float(case.t[0])
    near = scene.near(x, 0.0, t)
    g, (row, _, vals) = scene.gaps(t, x, near), scene.gradient_entries(t, x, near)
    if (g >= -tolerances(case, scene, t, x, near, projected=True)).all() or len(near) > LISTED:
        return x
    with np.errstate(all="ignore"):
        deep = float(np.nansum(np.fmax(0.0, -g) / np.sqrt(np.bincount(row, vals**2, len(g)))))
    try:
        y = _project_start(case, scene, x, t)
    except ValueError:
        return x
    return (
        y
        if float(np.abs(y - x).max()) <= max(FARTHER * deep, PRINTED * float(np.abs(x).max()))
        else None
    )


def _project_start(case, scene, x0, t):
    """The point where linearising the constraints gives the point itself; it stays feasible and
    nearest from there on."""
    y = x0
    moved = np.full(x0.size, np.inf)
    before = np.inf
    reach = 4.0 * scene.max_violation(t, x0)
    known = {}
    for _ in range(ITERATIONS):
        lines = LinearisedConstraints(case, scene, t, y, reach)
        still = STILL * np.maximum(np.abs(x0), max(float(np.abs(y - x0).max()), lines.size(known)))
        move = float(np.max(moved / np.maximum(still, TINY), initial=0.0))
        # a geometric series of moves; where they shrink no more, rounding is reached
        remains = move * move / (before - move) if move < before < np.inf else 0.0
        if (lines.g >= -lines.allowed).all() and move <= 1.0 and remains <= REMAINS:
            return y
        before = move
        tie = lines.coincident()
        if tie:
            raise InfeasibleStart(
                "degenerate",
                f"the start of {case.key} has coincident centres, {tie}: no feasible "
                'point is the nearest; part them, or give start="keep"',
            )
        d = lines.nearest(y - x0, known)
        if d is None:
            raise _none(case, scene)
        z = x0 + d
        far = _largest_displacement(scene, z - y)
        if 2.0 * far <= reach:  # else a pair that is not listed could be in the way
            y, moved = z, np.abs(z - y)
        reach = 4.0 * far
    raise ValueError(
        f"the start of {case.key} could not be projected in {ITERATIONS} steps (violation "
        f"{size_text(-lines.g.min())}, "
        f"last step {size_text(moved.max())}): the nearest feasible point is perhaps not unique"
    )


def _none(case, scene) -> InfeasibleStart:
    """No point meets the linearised constraints: there is none at all where the set is convex."""
    if all(
        isinstance(c, Affine) or (isinstance(c, Distance) and c.sign < 0) for c in scene.families
    ):
        return InfeasibleStart(
            "infeasible",
            f"the constraints of {case.key} leave no point: the start cannot be projected",
        )
    return InfeasibleStart(
        "infeasible",
        f"the constraints of {case.key} leave no point near the start, to first order: it cannot "
        f"be "
        'projected; give a feasible x0, or start="keep"',
    )


def _largest_displacement(scene, change):
    """Return the largest displacement of a hard particle."""
    parts = (change[c.start : c.start + m * c.dim].reshape(m, c.dim) for _, c, m in scene.hard)
    return max((float(np.sqrt((p * p).sum(1)).max(initial=0.0)) for p in parts), default=0.0)


class LinearisedConstraints:
    """The constraints near y, linearised there: g (m,), their gradients, by entries, and what g may
    miss by."""

    def __init__(self, case: Case, scene: ConstraintSet, t: float, y: np.ndarray, reach: float):
        self.near = scene.near(y, reach, t)
        self.n = scene.n
        self.g, (self._row, self._cols, self._vals) = (
            scene.gaps(t, y, self.near),
            scene.gradient_entries(t, y, self.near),
        )
        self.allowed = tolerances(case, scene, t, y, self.near, projected=True)
        self._sizes = lambda: term_sizes(scene, t, y, self.near)

    def size(self, known: dict[int, float]) -> float:
        """The largest length that a gap is the difference of, of those that push: `known`, by
        id."""
        norm = np.sqrt(np.bincount(self._row, self._vals**2, len(self.g)))
        push = np.isin(self.near.key, list(known)) & (norm > 0.0)
        return float((self._sizes()[push] / norm[push]).max(initial=0.0)) if push.any() else 0.0

    def coincident(self) -> tuple[int, int, int] | None:
        """A pair whose direction to part in is not known, or None."""
        near = self.near
        tie = np.flatnonzero(
            np.isin(near.kind, (PAIR, ANCHOR)) & (self.g == -near.sign * near.d) & (near.sign > 0.0)
        )
        return near.take(tie[:1]).ids[0] if tie.size else None

    def nearest(self, e: np.ndarray, known: dict[int, float]) -> np.ndarray | None:
        """The shortest d (n,) with g + G (d - e) >= 0, or None; known: multipliers by id, a guess
        that is renewed.

        Solved over some of the lines, to which those that are violated there are added, until none
        is.
        """
        along = np.bincount(self._row, self._vals * e[self._cols], len(self.g))
        q = self.g - along
        keys = self.near.key
        on = (self.g <= 0.0) | (q <= 0.0) | np.isin(keys, list(known))
        while True:
            listed = np.flatnonzero(on)
            keep = on[self._row]
            place = np.cumsum(on) - 1
            row = place[self._row[keep]]
            cols = self._cols[keep]
            vals = self._vals[keep]
            guess = np.array([known.get(k, 0.0) for k in keys[listed].tolist()])
            d, mu = least_distance(row, cols, vals, q[listed], self.n, guess)
            if d is None:
                return None
            w = q + np.bincount(self._row, self._vals * d[self._cols], len(q))
            known.clear()
            known.update(
                (k, m) for k, m in zip(keys[listed].tolist(), mu.tolist(), strict=True) if m > 0.0
            )
            new = (w < -0.1 * self.allowed) & ~on
            if not new.any():
                return d
            on |= new
