"""Constraints that leave no point: where a run violates them, or between two of its samples.

A projection moves somewhere even where there is nowhere to go: contradicting walls are met
half-way, and what is squeezed between them comes out on another side. Rows are looked at by linear
programs, links by shortest paths, the rest to first order.
Nothing is looked at where it cannot happen: a state that meets constraints at rest, be it the
start, proves that they leave one.
"""

from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.diagnostics.contacts.infeasible_links import links_too_short
from nsbench.diagnostics.contacts.infeasible_rows import RowFeasibility, phase_one
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.dynamics.contacts.tolerances import PRINTED, scene_of, tolerances, violates
from nsbench.solvers.common.initial_state import DENSE, least_distance
from nsbench.trajectory import Status, Trajectory

HALF = 0.5  # of the largest depth: where the run begins to violate its constraints as much
CURVED = (
    0.05  # part of a depth that the curvature of constraints may make of it, as long as it is small
)
BEYOND = (
    1e3  # times what all constraints miss by: a state that meets them so far away is another one
)
MANY = 3000  # constraints: beyond, the linear program takes seconds
TIMES = 200  # of a run at which walls and links are looked at, samples too
# of a run, in each of which the deepest sample is looked at: others may be deeper for other reasons
PARTS = 4


def check_infeasible_constraints(case: Case, traj: Trajectory) -> Status | None:
    """Walls or links that contradict each other at any time, or constraints that do where the run
    violates them most."""
    if case.exact is not None or not (
        case.start == "keep" or any(c.moving for c in case.problem.constraints)
    ):
        return None
    scene = scene_of(case)
    depth = np.array([scene.deepest(float(t), x) for t, x in zip(traj.t, traj.x, strict=True)])
    best = int(np.argmin(depth))
    if not scene.moving and not violates(case, scene, float(traj.t[best]), traj.x[best]):
        return None
    walls = RowFeasibility(case)
    for t, x in _moments(scene, traj):
        if why := walls.contradiction(t, x) or links_too_short(case, t):
            return Status("infeasible", why)
    for k in _deepest(depth):
        if why := _arrangement(case, scene, float(traj.t[k]), traj.x[k], float(depth[k])):
            return Status("infeasible", why)
    for k in _deepest(depth):
        if k and (
            why := _beyond(case, scene, float(traj.t[k]), traj.x[k], float(depth[k]))
        ):  # a start may be kept as it is
            return Status("unverified", why)
    return None


def _moments(scene: ConstraintSet, traj: Trajectory):
    """Times at which walls and links are looked at, and states around: all samples and, of few, the
    straight ways between, the coarsest grid of them first; of constraints at rest the start."""
    between = -(-TIMES // max(len(traj.t) - 1, 1))
    count = 1 + between * (len(traj.t) - 1) if scene.moving else 1
    for at in _coarse_first(count):
        k = at // between
        a = at % between / between
        t = traj.t[k : k + 2]
        x = traj.x[k : k + 2]
        yield (
            (float((1.0 - a) * t[0] + a * t[1]), (1.0 - a) * x[0] + a * x[1])
            if a
            else (float(t[0]), x[0])
        )


def _coarse_first(count: int) -> list[int]:
    """0 to count - 1: 0, then multiples of high powers of two first."""
    numbers = np.arange(1, count)
    return [0, *numbers[np.argsort(-(numbers & -numbers), kind="stable")].tolist()]


def _deepest(depth: np.ndarray) -> list[int]:
    """Samples, the deepest first: of the run, of what follows the start, which may be left as it
    is, of every part, and where the run begins to violate its constraints by HALF of its most."""
    parts = np.array_split(np.arange(len(depth)), PARTS)
    worst = {
        part[int(np.argmax(depth[part]))]
        for part in (*parts, np.arange(1, len(depth)))
        if len(part)
    }
    worst.add(int(np.argmax(depth >= HALF * depth.max())))
    return sorted((int(k) for k in worst if depth[k] > 0.0), key=lambda k: -depth[k])


def _arrangement(
    case: Case, scene: ConstraintSet, t: float, x: np.ndarray, depth: float
) -> str | None:
    """Why no small move from x meets all constraints that touch there; None where one does, or
    where they are too many.

    A linear program of the linearised constraints. For links and rods it is no more than what they
    ask; hard particles may not change places, as they could by a long move. The curvature of what
    is deep is why a part of the depth is allowed.
    """
    near = scene.near(x, 0.0, t)
    if not 1 < len(near) <= MANY:
        return None
    row, col, vals = scene.triplets(t, x, near)
    order = np.argsort(row, kind="stable")
    ptr = np.searchsorted(row[order], np.arange(len(near) + 1))
    col = col[order]
    vals = vals[order]
    miss = phase_one(
        ptr, col, vals, scene.gaps(t, x, near), scene.n, tolerances(case, scene, t, x, near)
    )
    if not miss.least > CURVED * miss.deep:
        return None
    return (
        f"The constraints contradict each other at t = {t:.6g} where the run violates them by "
        f"{depth:.3g}: to first order, "
        f"every way on misses one of them by {miss.least:.3g} or more."
    )


def _beyond(case: Case, scene: ConstraintSet, t: float, x: np.ndarray, depth: float) -> str | None:
    """Why what meets the constraints is not about as far from x as x violates them; None where it
    is, where none does to first order, or where they are many.

    Projections one by one hardly move what is squeezed in a straight row, for it yields to the side
    only: a violation that no step mends, however small it is, hides a way as long as a part of its
    square root.
    """
    near = scene.near(x, depth, t)
    if not 0 < len(near) * scene.n <= DENSE:
        return None
    g = scene.gaps(t, x, near)
    (row, col, vals) = scene.triplets(t, x, near)
    norm = np.sqrt(np.bincount(row, vals * vals, len(g)))
    if not (
        np.all((norm > 0.0) & (norm < np.inf)) and np.any(g < -tolerances(case, scene, t, x, near))
    ):
        return None
    way, _ = least_distance(row, col, vals, g, scene.n, np.zeros(len(g)))
    allowed = max(BEYOND * float((np.fmax(0.0, -g) / norm).sum()), PRINTED * float(np.abs(x).max()))
    if way is None or (far := float(np.abs(way).max())) <= allowed:
        return None
    return (
        f"At t = {t:.6g} the run violates its constraints by {depth:.3g} where what meets them is "
        f"much farther away: "
        f"{far:.3g} to first order."
    )


def contradiction(case: Case, t: float, x: np.ndarray | None = None) -> str | None:
    """Why no state meets all rows, or all links, at time t; None where they do not contradict each
    other.

    Rows by a linear program around x (n,), the start where none is given; links by shortest paths:
    anchors further apart than the links between them are long. Other contradictions are not looked
    for.
    """
    return RowFeasibility(case).contradiction(t, case.x0 if x is None else x) or links_too_short(
        case, t
    )
