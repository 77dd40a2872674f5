"""Constraints that leave no point: where a run violates them, or between two of its samples.

A projection moves somewhere even where there is nowhere to go: contradicting walls are met half-way, and what is squeezed
between them comes out on another side. Rows are looked at by linear programs, links by shortest paths, the rest to first order.
Nothing is looked at where it cannot happen: a start that was found feasible proves that constraints at rest leave a point.
"""
from __future__ import annotations

import functools

import numpy as np

from nsbench.case import Case
from nsbench.contacts import ANCHOR, PAIR, Scene
from nsbench.problem import Distance
from nsbench.solvers._extent import TIMES, scene_of, size, walls
from nsbench.trajectory import Status, Trajectory

MISSED = 1e-9            # relative to the scene: what walls may contradict each other by; ten times what the linear program is
SOLVED = 1e-10           # solved to
ROUNDED = 1e-11          # of the largest coordinate: rounding, also of whoever made the numbers
HALF = 0.5               # of the largest depth: where the run begins to violate its constraints as much
CURVED = 0.05            # part of a depth that the curvature of constraints may make of it, as long as it is small
MANY = 3000              # constraints: beyond, the linear program takes seconds
PARTS, WORST = 4, 3      # of a run, an infeasible start being far from where walls meet later; in each, the programs solved


def _visible(case: Case, moved: float = 0.0) -> float:
    """What constraints may contradict each other by, as a length."""
    far, coordinate = size(case)
    return MISSED * max(far, moved) + ROUNDED * coordinate


def nowhere(case: Case, traj: Trajectory) -> Status | None:
    """Constraints that contradict each other where the run violates them most, or begins to violate them as much."""
    if case.exact is not None or not (case.start == "keep" or any(c.moving for c in case.problem.constraints)):
        return None
    scene = scene_of(case)
    depth = np.array([scene.deepest(float(t), x) for t, x in zip(traj.t, traj.x, strict=True)])
    later = int(np.argmax(depth[1:])) + 1 if len(depth) > 1 else 0           # a start may be left as it is
    deepest, why = {int(np.argmax(depth)), later}, None
    for worst in sorted(deepest, key=lambda k: -depth[k]):
        if why or not depth[worst] > _visible(case, float(np.abs(traj.x[worst] - case.x0).max())):
            break
        why = contradiction(case, float(case.t[worst] if scene.moving else case.t[0]))
        first = int(np.argmax(depth >= HALF * depth[worst]))
        for k in dict.fromkeys((worst, first)):
            why = why or _arrangement(case, float(traj.t[k]), traj.x[k], float(depth[k]))
    why = why or _between(case, scene, traj)
    return None if why is None else Status("infeasible", why)


def _between(case: Case, scene: Scene, traj: Trajectory) -> str | None:
    """Why moving walls or anchors leave no point for a while between two samples: links at all times looked at, walls at those
    at which the straight way from one sample to the next violates constraints most."""
    if not scene.moving or len(traj.t) < 2:
        return None
    between = -(-TIMES // (len(traj.t) - 1))
    a = np.arange(1, between) / between
    times = (traj.t[:-1, None] + np.diff(traj.t)[:, None] * a).ravel()
    for t in times:
        if why := _links(case, scene, float(t)):
            return why
    if len(scene.ptr) < 3:
        return None
    states = (traj.x[:-1, None] + np.diff(traj.x, axis=0)[:, None] * a[:, None]).reshape(len(times), -1)
    deep = np.array([scene.deepest(float(t), x) for t, x in zip(times, states, strict=True)])
    for part in np.array_split(np.arange(len(times)), PARTS):
        for k in part[np.argsort(-deep[part], kind="stable")[:WORST]]:
            if deep[k] > 0.0 and (why := contradiction(case, float(times[k]))):
                return why
    return None


def passed(case: Case, traj: Trajectory) -> Status | None:
    """Hard particles on a line that changed places, or that an anchor went through: a step too long, or no room."""
    if not any(isinstance(c, Distance) and c.sign > 0 and c.dim == 1 for c in case.problem.constraints):
        return None
    scene = scene_of(case)
    near = scene.all_static()
    for _, c, m in (family for family in scene.hard if family[1].dim == 1):
        line = traj.x[:, c.start:c.start + m]
        order = np.argsort(line[0])
        swapped = np.argwhere((np.diff(line[:, order]) < 0.0) & (np.diff(line[0, order]) > 0.0))
        if len(swapped):
            k, i = swapped[0]
            return _through(traj.t[k], f"particles {order[i]} and {order[i + 1]} have changed places")
    for e in np.flatnonzero(np.isin(near.kind, (PAIR, ANCHOR)) & (near.sign > 0) & (near.dim == 1)):
        other = traj.x[:, near.q[e]] if near.kind[e] == PAIR else np.array([scene.anchors(float(t))[near.q[e]] for t in traj.t])
        side = traj.x[:, near.p[e]] - other
        if side[0] != 0.0 and (side * side[0] < 0.0).any():
            k = int(np.argmax(side * side[0] < 0.0))
            return _through(traj.t[k], f"the two of contact {near.ids[int(e)]} have changed places")
    return None


def _through(t: float, what: str) -> Status:
    return Status("unverified", f"By t = {t:.6g} {what}, on a line, where nothing leads around: steps are too long, or there was "
                                "no room between them.")


def _arrangement(case: Case, t: float, x: np.ndarray, depth: float) -> str | None:
    """Why no small move from x meets all constraints that touch there; None where one does, or where they are too many.

    The linear program of `_rows`, of the linearised constraints. For links and rods it is no more than what they ask; hard
    particles may not change places, as they could by a long move. The curvature of what is deep is why a part of the
    depth is allowed.
    """
    scene = scene_of(case)
    near, moved = scene.near(x, 0.0, t), float(np.abs(x - case.x0).max())
    if not 1 < len(near) <= MANY:
        return None
    row, col, vals = scene.triplets(t, x, near)
    order = np.argsort(row, kind="stable")
    ptr, col, vals = np.searchsorted(row[order], np.arange(len(near) + 1)), col[order], vals[order]
    missed = _least_miss(ptr, col, vals, scene.gaps(t, x, near), scene.n)
    if missed <= max(CURVED * depth, _visible(case, moved)):
        return None
    return (f"The constraints contradict each other at t = {t:.6g} where the run violates them by {depth:.3g}: to first order, "
            f"every way on misses one of them by {missed:.3g} or more.")


@functools.lru_cache(maxsize=512)
def contradiction(case: Case, t: float) -> str | None:
    """Why no state meets all rows, or all links, at time t; None where they do not contradict each other.

    Rows by a linear program, normalised: the least s with A x + b + s >= 0 for some x. Links by shortest paths: anchors
    further apart than the links between them are long. Other contradictions are not looked for.
    """
    return _rows(case, scene_of(case), t) or _links(case, scene_of(case), t)


def _rows(case: Case, scene: Scene, t: float) -> str | None:
    if len(scene.ptr) < 3:
        return None
    missed = _least_miss(scene.ptr, scene.cols, scene.vals, walls(scene, scene.b(t), case.x0), scene.n)
    if missed <= _visible(case):
        return None
    return f"The walls contradict each other at t = {t:.6g}: every state misses one of them by {missed:.3g} or more."


def _least_miss(ptr, cols, vals, g, n: int) -> float:
    """The least s >= 0 with A d + g + s >= 0 for some d, rows of A normalised; 0.0 where the program is not solved.

    d is a way from a point with gaps g. Solved in units of the largest gap: the tolerances of the program are absolute.
    """
    from scipy.optimize import linprog
    from scipy.sparse import csr_matrix, hstack
    rows = np.repeat(np.arange(len(g)), np.diff(ptr))
    norm = 1.0 / np.sqrt(np.bincount(rows, vals * vals, len(g)))
    unit = float(np.abs(g * norm).max(initial=0.0))
    if not (np.isfinite(norm).all() and 0.0 < unit < np.inf):          # walls through the point: it is one of all
        return 0.0
    A = csr_matrix((vals * norm[rows], cols, ptr), (len(g), n))
    found = linprog(np.append(np.zeros(n), 1.0), A_ub=-hstack([A, np.ones((len(g), 1))]).tocsr(), b_ub=g * norm / unit,
                    bounds=[(None, None)] * n + [(0.0, None)],
                    options={"primal_feasibility_tolerance": SOLVED, "dual_feasibility_tolerance": SOLVED})
    return 0.0 if found.status else unit * float(found.x[-1])


def _links(case: Case, scene: Scene, t: float) -> str | None:
    found = _chains(case)
    if found is None:
        return None
    at, reach = scene.anchors(t)[found[0]], found[1]
    apart = np.sqrt(((at[:, None] - at[None]) ** 2).sum(-1))
    short = apart - reach
    i, j = np.unravel_index(int(np.argmax(short)), short.shape)
    if short[i, j] <= _visible(case):
        return None
    return (f"The links are too short at t = {t:.6g}: two anchors are {apart[i, j]:.6g} apart, and the links between them "
            f"{reach[i, j]:.6g} long.")


@functools.lru_cache(maxsize=64)
def _chains(case: Case):
    """Coordinates of the anchors of links (m, dim), and how far apart the links between them let them be (m, m), or None."""
    scene = scene_of(case)
    links = [c for c in scene.families if isinstance(c, Distance) and c.sign < 0]
    if not any(c.anchors is not None for c in links):
        return None
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import shortest_path
    near, points = scene.all_static(), scene.anchors(float(case.t[0]))
    use = np.flatnonzero(np.isin(near.kind, (PAIR, ANCHOR)) & (near.sign < 0))
    # nodes: particles by their first coordinate, then anchors by theirs
    p, q = near.p[use], np.where(near.kind[use] == ANCHOR, case.n + near.q[use], near.q[use])
    size = case.n + len(points)
    order = np.lexsort((near.d[use], q, p))               # of several links of one pair the shortest: a sparse array adds them
    order = order[np.append(True, (np.diff(p[order]) != 0) | (np.diff(q[order]) != 0))]
    graph = coo_matrix((near.d[use][order], (p[order], q[order])), (size, size)).tocsr()
    ends = np.unique(q[q >= case.n])
    reach = shortest_path(graph, directed=False, indices=ends)[:, ends]
    return (ends - case.n)[:, None] + np.arange(int(near.dim[use][0])), reach
