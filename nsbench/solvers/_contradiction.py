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
from nsbench.solvers._extent import scene_of
from nsbench.trajectory import Status, Trajectory

MISSED = 1e-9            # of the length of a chain: what it may be too short by
SOLVED = 1e-10           # of the farthest constraint looked at: what a linear program is solved to
ROUNDED = 1e-11          # of the largest coordinate: rounding, also of whoever made the numbers
HALF = 0.5               # of the largest depth: where the run begins to violate its constraints as much
CURVED = 0.05            # part of a depth that the curvature of constraints may make of it, as long as it is small
FAR = 1e4                # of the depth: constraints farther away take no part in a contradiction
MANY = 3000              # constraints: beyond, the linear program takes seconds
ENDS = 200               # anchored links between which the ways are looked at
TIMES = 200              # of a run at which walls and links are looked at, samples too
PARTS, WORST = 4, 3      # of a run, an infeasible start being far from where walls meet later; in each, the programs solved


def nowhere(case: Case, traj: Trajectory) -> Status | None:
    """Constraints that contradict each other where the run violates them most, or begins to violate them as much."""
    if case.exact is not None or not (case.start == "keep" or any(c.moving for c in case.problem.constraints)):
        return None
    scene = scene_of(case)
    depth = np.array([scene.deepest(float(t), x) for t, x in zip(traj.t, traj.x, strict=True)])
    later = int(np.argmax(depth[1:])) + 1 if len(depth) > 1 else 0           # a start may be left as it is
    why = None
    for worst in sorted({int(np.argmax(depth)), later}, key=lambda k: -depth[k]):
        if why or not depth[worst] > 0.0:
            break
        why = contradiction(case, float(traj.t[worst] if scene.moving else traj.t[0]), traj.x[worst])
        first = int(np.argmax(depth >= HALF * depth[worst]))
        for k in dict.fromkeys((worst, first)):
            why = why or _arrangement(scene, float(traj.t[k]), traj.x[k], float(depth[k]))
    why = why or _between(scene, traj, case)
    return None if why is None else Status("infeasible", why)


def _between(scene: Scene, traj: Trajectory, case: Case) -> str | None:
    """Why moving walls or anchors leave no point for a while between two samples: links at all times looked at, walls at those
    at which the straight way from one sample to the next violates constraints most."""
    if not scene.moving or len(traj.t) < 2:
        return None
    between = -(-TIMES // (len(traj.t) - 1))
    places = [(k, j / between) for k in range(len(traj.t) - 1) for j in range(1, between)]
    time = lambda k, a: float((1.0 - a) * traj.t[k] + a * traj.t[k + 1])
    state = lambda k, a: (1.0 - a) * traj.x[k] + a * traj.x[k + 1]
    for place in places:
        if why := _links(case, scene, time(*place)):
            return why
    if len(scene.ptr) < 3:
        return None
    deep = np.array([scene.deepest(time(*place), state(*place)) for place in places])
    for part in np.array_split(np.arange(len(places)), PARTS):
        for k in part[np.argsort(-deep[part], kind="stable")[:WORST]]:
            if deep[k] > 0.0 and (why := _rows(scene, time(*places[k]), state(*places[k]))):
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
    missed, deepest = _least_miss(ptr, col, vals, scene.gaps(t, x, near), scene.n)
    if missed <= max(CURVED * deepest, ROUNDED * float(np.abs(x).max())):
        return None
    return (f"The constraints contradict each other at t = {t:.6g} where the run violates them by {depth:.3g}: to first order, "
            f"every way on misses one of them by {missed:.3g} or more.")


def contradiction(case: Case, t: float, x: np.ndarray | None = None) -> str | None:
    """Why no state meets all rows, or all links, at time t; None where they do not contradict each other.

    Rows by a linear program around x (n,), the start where none is given: those that are not much farther away than what is
    violated there. Links by shortest paths: anchors further apart than the links between them are long. Other contradictions
    are not looked for.
    """
    scene = scene_of(case)
    return _rows(scene, t, case.x0 if x is None else x) or _links(case, scene, t)


def _rows(scene: Scene, t: float, x: np.ndarray) -> str | None:
    if len(scene.ptr) < 3:
        return None
    b, terms = scene.b(t), scene.vals * x[scene.cols]
    missed, _ = _least_miss(scene.ptr, scene.cols, scene.vals, np.add.reduceat(terms, scene.ptr[:-1]) + b, scene.n,
                            np.add.reduceat(np.abs(terms), scene.ptr[:-1]) + np.abs(b))
    if not missed > 0.0:
        return None
    return f"The walls contradict each other at t = {t:.6g}: every state misses one of them by {missed:.3g} or more."


def _least_miss(ptr, cols, vals, g, n: int, terms=None) -> tuple[float, float]:
    """The least s >= 0 with A d + g + s >= 0 for some d, and the largest -g, rows of A normalised: lengths.

    Of rows with g beyond FAR times the largest -g nothing is asked. 0.0 where the program is not solved, or s is what
    rounding of `terms` (of which g are differences) or of the program may leave.
    """
    from scipy.optimize import linprog
    from scipy.sparse import csr_matrix, hstack
    rows = np.repeat(np.arange(len(g)), np.diff(ptr))
    with np.errstate(divide="ignore", invalid="ignore"):
        norm = 1.0 / np.sqrt(np.bincount(rows, vals * vals, len(g)))
        g = np.where(np.isfinite(norm), g * norm, np.inf)            # a row of zeros asks nothing of a state
    deep = float(-np.min(g, initial=0.0))
    use = np.flatnonzero(g <= FAR * deep)
    if not (0.0 < deep < np.inf) or np.isnan(g).any():
        return 0.0, 0.0
    A = csr_matrix((vals * np.where(np.isfinite(norm), norm, 0.0)[rows], cols, ptr), (len(g), n))[use]
    unit = float(np.abs(g[use]).max())
    found = linprog(np.append(np.zeros(n), 1.0), A_ub=-hstack([A, np.ones((len(use), 1))]).tocsr(), b_ub=g[use] / unit,
                    bounds=[(None, None)] * n + [(0.0, None)],
                    options={"primal_feasibility_tolerance": SOLVED, "dual_feasibility_tolerance": SOLVED})
    missed = 0.0 if found.status else unit * float(found.x[-1])
    least = 10.0 * SOLVED * unit + (0.0 if terms is None else ROUNDED * float((terms * norm)[use].max()))
    return (missed if missed > least else 0.0), deep


def _links(case: Case, scene: Scene, t: float) -> str | None:
    for at, reach in _chains(case):
        at = scene.anchors(t)[at]
        apart = np.sqrt(((at[:, None] - at[None]) ** 2).sum(-1))
        short = apart - reach - MISSED * np.where(np.isfinite(reach), reach, 0.0)
        i, j = np.unravel_index(int(np.argmax(short)), short.shape)
        if short[i, j] > ROUNDED * float(np.abs(at).max()):
            return (f"The links are too short at t = {t:.6g}: two anchors are {apart[i, j]:.6g} apart, and the links between "
                    f"them {reach[i, j]:.6g} long.")
    return None


@functools.lru_cache(maxsize=64)
def _chains(case: Case) -> list[tuple]:
    """By dimension of the links: coordinates of their anchors (m, dim), of ENDS at most, and how far apart the links between
    them let them be (m, m)."""
    scene = scene_of(case)
    near, out = scene.all_static(), []
    links = near.take(np.isin(near.kind, (PAIR, ANCHOR)) & (near.sign < 0))
    for dim in np.unique(links.dim[links.kind == ANCHOR]):
        of = links.take(links.dim == dim)
        # nodes: particles by their first coordinate, then anchors by theirs
        p, q = of.p, np.where(of.kind == ANCHOR, case.n + of.q, of.q)
        ends = np.unique(q[q >= case.n])[:ENDS]
        if len(ends) > 1:
            out.append(((ends - case.n)[:, None] + np.arange(dim), _reach(p, q, of.d, ends)))
    return out


def _reach(p, q, d, ends) -> np.ndarray:
    """(m, m) lengths of the shortest ways between `ends` along edges (p, q) of length d; inf where there is none."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import shortest_path
    order = np.lexsort((d, q, p))                        # of several links of one pair the shortest: a sparse array adds them
    order = order[np.append(True, (np.diff(p[order]) != 0) | (np.diff(q[order]) != 0))]
    size = int(max(p.max(), q.max())) + 1
    graph = coo_matrix((d[order], (p[order], q[order])), (size, size)).tocsr()
    return shortest_path(graph, directed=False, indices=ends)[:, ends]
