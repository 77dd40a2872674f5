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
from nsbench.trajectory import Status, Trajectory

MISSED = 1e-9            # relative to the state: what walls may contradict each other by; ten times what the linear program is
SOLVED = 1e-10           # solved to
HALF = 0.5               # of the largest depth: where the run begins to violate its constraints as much
CURVED = 0.05            # part of a depth that the curvature of constraints may make of it, as long as it is small
MANY = 3000              # constraints: beyond, the linear program takes seconds
TIMES, WORST = 200, 3    # of a run at which walls and links are looked at, samples too; of these, the programs solved


@functools.lru_cache(maxsize=64)
def scene_of(case: Case) -> Scene:
    return Scene(case.problem, case.n)


def nowhere(case: Case, traj: Trajectory) -> Status | None:
    """Constraints that contradict each other where the run violates them most, or begins to violate them as much."""
    if case.exact is not None or not (case.start == "keep" or any(c.moving for c in case.problem.constraints)):
        return None
    scene = scene_of(case)
    depth = np.array([scene.deepest(float(t), x) for t, x in zip(traj.t, traj.x, strict=True)])
    worst, why = int(np.argmax(depth)), None
    if depth[worst] > MISSED * max(1.0, float(np.abs(traj.x[worst]).max())):
        why = contradiction(case, float(case.t[worst] if scene.moving else case.t[0]))
        first = int(np.argmax(depth >= HALF * depth[worst]))
        for k in dict.fromkeys((worst, first)):
            why = why or _arrangement(scene, float(traj.t[k]), traj.x[k], float(depth[k]))
    why = why or _between(case, scene, traj)
    return None if why is None else Status("infeasible", why)


def _between(case: Case, scene: Scene, traj: Trajectory) -> str | None:
    """Why moving walls or anchors leave no point for a while between two samples: at times at which the straight way from one
    to the next violates constraints most."""
    parts = -(-TIMES // (len(traj.t) - 1)) if scene.moving and len(traj.t) > 1 else 1
    deep = []
    for j in range(1, parts):
        a = j / parts
        times, states = traj.t[:-1] + a * np.diff(traj.t), (1.0 - a) * traj.x[:-1] + a * traj.x[1:]
        deep += [(-scene.deepest(float(t), x), float(t)) for t, x in zip(times, states, strict=True)]
    for depth, t in sorted(deep)[:WORST]:
        if depth < 0.0 and (why := contradiction(case, t)):
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


def _arrangement(scene: Scene, t: float, x: np.ndarray, depth: float) -> str | None:
    """Why no small move from x meets all constraints that touch there; None where one does, or where they are too many.

    The linear program of `_rows`, of the linearised constraints. For links and rods it is no more than what they ask; hard
    particles may not change places, as they could by a long move. The curvature of what is deep is why a part of the
    depth is allowed.
    """
    near = scene.near(x, 0.0, t)
    if not 1 < len(near) <= MANY:
        return None
    row, col, vals = scene.triplets(t, x, near)
    order = np.argsort(row, kind="stable")
    ptr, col, vals = np.searchsorted(row[order], np.arange(len(near) + 1)), col[order], vals[order]
    missed = _least_miss(ptr, col, vals, scene.gaps(t, x, near), scene.n)
    if missed <= max(CURVED * depth, MISSED * max(1.0, float(np.abs(x).max()))):
        return None
    return (f"The constraints contradict each other at t = {t:.6g} where the run violates them by {depth:.3g}: to first order, "
            f"every way on misses one of them by {missed:.3g} or more.")


@functools.lru_cache(maxsize=512)
def contradiction(case: Case, t: float) -> str | None:
    """Why no state meets all rows, or all links, at time t; None where they do not contradict each other.

    Rows by a linear program, normalised: the least s with A x + b + s >= 0 for some x. Links by shortest paths: anchors
    further apart than the links between them are long. Other contradictions are not looked for.
    """
    return _rows(scene_of(case), t) or _links(case, scene_of(case), t)


def _rows(scene: Scene, t: float) -> str | None:
    if len(scene.ptr) < 3:
        return None
    missed = _least_miss(scene.ptr, scene.cols, scene.vals, scene.b(t), scene.n)
    if missed <= MISSED * max(1.0, float(np.abs(scene.b(t) * np.sqrt(scene.inv2)).max(initial=0.0))):
        return None
    return f"The walls contradict each other at t = {t:.6g}: every state misses one of them by {missed:.3g} or more."


def _least_miss(ptr, cols, vals, b, n: int) -> float:
    """The least s >= 0 with A x + b + s >= 0 for some x, rows of A normalised; 0.0 where the program is not solved."""
    from scipy.optimize import linprog
    from scipy.sparse import csr_matrix, hstack
    rows = np.repeat(np.arange(len(b)), np.diff(ptr))
    norm = 1.0 / np.sqrt(np.bincount(rows, vals * vals, len(b)))
    if not (np.isfinite(norm).all() and np.isfinite(b * norm).all()):
        return 0.0
    A = csr_matrix((vals * norm[rows], cols, ptr), (len(b), n))
    found = linprog(np.append(np.zeros(n), 1.0), A_ub=-hstack([A, np.ones((len(b), 1))]).tocsr(), b_ub=b * norm,
                    bounds=[(None, None)] * n + [(0.0, None)],
                    options={"primal_feasibility_tolerance": SOLVED, "dual_feasibility_tolerance": SOLVED})
    return 0.0 if found.status else float(found.x[-1])


def _links(case: Case, scene: Scene, t: float) -> str | None:
    links = [(k, c) for k, c in enumerate(scene.families) if isinstance(c, Distance) and c.sign < 0]
    if not any(c.anchors is not None for _, c in links):
        return None
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import shortest_path
    near, points = scene.all_static(), scene.anchors(t)
    use = np.flatnonzero(np.isin(near.kind, (PAIR, ANCHOR)) & (near.sign < 0))
    # nodes: particles by their first coordinate, then anchors by theirs
    p, q = near.p[use], np.where(near.kind[use] == ANCHOR, case.n + near.q[use], near.q[use])
    size = case.n + len(points)
    graph = coo_matrix((near.d[use], (p, q)), (size, size)).tocsr()
    ends = np.unique(q[q >= case.n])
    reach = shortest_path(graph, directed=False, indices=ends)[:, ends]
    dim = int(near.dim[use][0])
    at = points[(ends - case.n)[:, None] + np.arange(dim)]
    apart = np.sqrt(((at[:, None] - at[None]) ** 2).sum(-1))
    short = apart - np.where(np.isfinite(reach), reach, np.inf)
    i, j = np.unravel_index(int(np.argmax(short)), short.shape)
    if short[i, j] <= MISSED * max(1.0, float(apart.max())):
        return None
    return (f"The links are too short at t = {t:.6g}: two anchors are {apart[i, j]:.6g} apart, and the links between them "
            f"{reach[i, j]:.6g} long.")


