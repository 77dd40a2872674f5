"""Check: constraints that contradict each other at a violated state or at one between samples.

A projection returns a point even where no feasible one exists: contradicting walls are met
half-way, and what is squeezed between them comes out on another side. Affine rows are checked by
linear programs, links by shortest paths, all other constraints to first order. A state that
satisfies constraints at rest, be it the start, proves that they are feasible: then nothing is
checked.
"""

from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.case.scale import size_text, time_text
from nsbench.diagnostics.base import Finding
from nsbench.diagnostics.contacts.infeasible_links import links_too_short
from nsbench.diagnostics.contacts.infeasible_rows import RowFeasibility, phase_one
from nsbench.diagnostics.run_view import RunView
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.dynamics.contacts.tolerances import PRINTED, scene_of, tolerances, violates
from nsbench.qp.projection import DENSE, least_distance
from nsbench.trajectory import Trajectory

HALF = 0.5  # of the largest violation: where the run begins to violate its constraints as much
# part of a violation that the curvature of the constraints may account for, if it is small
CURVATURE = 0.05
# times the sum of all violations: a feasible state at this distance belongs to another motion
FAR_FEASIBLE = 1e3
MAX_CONSTRAINTS = 3000  # beyond, the linear program takes seconds
MIN_TIMES = 200  # of a run at which walls and links are checked, samples among them
# of a run, in each of which the worst sample is checked: others may be worse for other reasons
PARTS = 4


def check_infeasible_constraints(run: RunView) -> Finding | None:
    """Find walls or links that contradict each other at any time of the run, or constraints there.

    Constraints of any kind are checked where the run violates them most: by the linear program of
    their linearisation, and by the distance to a state that satisfies it.
    """
    case = run.case
    constraints = case.problem.constraints
    if not constraints or not (case.start == "keep" or any(c.moving for c in constraints)):
        return None
    traj = run.trajectory
    scene = scene_of(case)
    depth = run.violations
    best = int(np.argmin(depth))
    if not scene.moving and not violates(case, scene, float(traj.t[best]), traj.x[best]):
        return None
    walls = RowFeasibility(case)
    for t, x in _checked_times(scene, traj):
        if why := walls.contradiction(t, x) or links_too_short(case, t):
            return Finding("infeasible", why)
    for k in _worst_samples(depth):
        if why := _contradiction_nearby(case, scene, float(traj.t[k]), traj.x[k], float(depth[k])):
            return Finding("infeasible", why)
    for k in _worst_samples(depth):
        if k == 0:  # a start may violate its constraints by declaration
            continue
        if why := _far_from_feasible(case, scene, float(traj.t[k]), traj.x[k], float(depth[k])):
            return Finding("unverified", why)
    return None


def _checked_times(scene: ConstraintSet, traj: Trajectory):
    """Yield times at which walls and links are checked, and states near, coarse grids first.

    All samples and, if they are few, points of the polygon between; of constraints at rest the
    start alone.
    """
    between = -(-MIN_TIMES // max(len(traj.t) - 1, 1))
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
    """Return 0 to count - 1 in the order of nested grids: multiples of high powers of two first."""
    numbers = np.arange(1, count)
    return [0, *numbers[np.argsort(-(numbers & -numbers), kind="stable")].tolist()]


def _worst_samples(depth: np.ndarray) -> list[int]:
    """Return the samples with the largest violations, the worst first.

    Of the run, of all after the start (which may violate by declaration), of each of PARTS parts,
    and where the violation first exceeds HALF of its maximum.
    """
    parts = np.array_split(np.arange(len(depth)), PARTS)
    worst = {
        part[int(np.argmax(depth[part]))]
        for part in (*parts, np.arange(1, len(depth)))
        if len(part)
    }
    worst.add(int(np.argmax(depth >= HALF * depth.max())))
    return sorted((int(k) for k in worst if depth[k] > 0.0), key=lambda k: -depth[k])


def _contradiction_nearby(
    case: Case, scene: ConstraintSet, t: float, x: np.ndarray, depth: float
) -> str | None:
    """Explain why no small displacement of x satisfies all constraints that touch there, or None.

    Phase-I linear program of the linearised constraints; None also if they are too many. For links
    and rods the linearisation is no more than they require; hard particles may not change places,
    as they could by a large displacement. A part of the violation is allowed for curvature.
    """
    near = scene.near(x, 0.0, t)
    if not 1 < len(near) <= MAX_CONSTRAINTS:
        return None
    row, col, vals = scene.gradient_entries(t, x, near)
    order = np.argsort(row, kind="stable")
    ptr = np.searchsorted(row[order], np.arange(len(near) + 1))
    allowed = tolerances(case, scene, t, x, near)
    gaps = scene.gaps(t, x, near)
    miss = phase_one(ptr, col[order], vals[order], gaps, scene.n, allowed)
    if not miss.least > CURVATURE * miss.deep:
        return None
    return (
        f"The constraints contradict each other at t = {time_text(t, 6)} where the run violates "
        "them by "
        f"{size_text(depth)}: to first order, every way on misses one of them by "
        f"{size_text(miss.least)} or more."
    )


def _far_from_feasible(
    case: Case, scene: ConstraintSet, t: float, x: np.ndarray, depth: float
) -> str | None:
    """Explain that a feasible state is much farther from x than it is violated, or None.

    Gauss-Seidel projections hardly move what is squeezed in a straight row, for it yields sideways
    only: a violation that no step repairs, however small, hides a displacement as long as a part of
    its square root. None also where no state is feasible to first order, or the problem is large.
    """
    near = scene.near(x, depth, t)
    if not 0 < len(near) * scene.n <= DENSE:
        return None
    g = scene.gaps(t, x, near)
    row, col, vals = scene.gradient_entries(t, x, near)
    norm = np.sqrt(np.bincount(row, vals * vals, len(g)))
    if not np.all((norm > 0.0) & (norm < np.inf)):
        return None
    if not np.any(g < -tolerances(case, scene, t, x, near)):
        return None
    d, _ = least_distance(row, col, vals, g, scene.n, np.zeros(len(g)))
    if d is None:
        return None
    violation = float((np.fmax(0.0, -g) / norm).sum())
    distance = float(np.abs(d).max())
    if distance <= max(FAR_FEASIBLE * violation, PRINTED * float(np.abs(x).max())):
        return None
    return (
        f"At t = {time_text(t, 6)} the run violates its constraints by {size_text(depth)} where "
        "what meets them is "
        f"much farther away: {size_text(distance)} to first order."
    )


def contradiction(case: Case, t: float, x: np.ndarray | None = None) -> str | None:
    """Explain why no state satisfies all rows, or all links, at time t; None if they are feasible.

    Rows by a linear program around x (n,), the start if none is given; links by shortest paths:
    anchors further apart than the links between them are long. Other contradictions are not
    searched for.
    """
    return RowFeasibility(case).contradiction(t, case.x0 if x is None else x) or links_too_short(
        case, t
    )
