"""What a run that says ok may not know: that its constraints leave no point or no direction to push in, that it is rounding.

A projection moves somewhere even where there is nowhere to go: contradicting walls are met half-way, and a constraint
whose gradient vanishes throws the state far away. Whatever the method, such a run is no solution, and is not called ok.
Nothing is looked at where it cannot happen: a start that was found feasible proves that constraints at rest leave a point.
Steps round the state: where they are so many that their roundings can add up to a part of the motion, nothing is known.
"""
from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np

from nsbench.case import Case
from nsbench.contacts import ANCHOR, PAIR, Scene
from nsbench.problem import LCS, Complementarity, Distance, Smooth
from nsbench.solvers._poles import pole
from nsbench.trajectory import Status, Trajectory

EPS = float(np.finfo(float).eps)
GREW = 10.0              # over the start's size, and over that of half of the samples
ROUNDED = 1e-2           # part of the motion that roundings of all steps may add up to
MISSED = 1e-7            # relative to the state: what walls may contradict each other by, as the linear program is solved
HALF = 0.5               # of the largest depth: where the run begins to violate its constraints as much
CURVED = 0.05            # part of a depth that the curvature of constraints may make of it, as long as it is small
MANY = 3000              # constraints: beyond, the linear program takes seconds
FLAT = 1e-6              # gradient over its largest along the run: below it a constraint does not push but throws


def doubted(case: Case, traj: Trajectory) -> Trajectory:
    """The run with the status infeasible, degenerate or unverified where it says ok and cannot be; itself everywhere else."""
    p = case.problem
    if not traj.status.ok or not len(traj.t):
        return traj
    with np.errstate(all="ignore"):
        status = pole(case, traj) or _overshot(case, traj) or _rounded(case, traj)
        if isinstance(p, Complementarity) and p.constraints:
            status = _tied(case) or _nowhere(case, traj) or _flat(case, traj) or status
    return traj if status is None else replace(traj, status=status)


def _overshot(case: Case, traj: Trajectory) -> Status | None:
    """A state that grew although the drift pulls back: steps h of it lead over to the other side, further away each time.

    An explicit step multiplies what decays with rate r by 1 - r h, which grows beyond r h = 2 (Hairer & Wanner, Solving ODEs
    II, chapter IV.2). Looked at where the samples are largest: |drift| h of more than twice the state, and against it.
    """
    h, p = float(traj.stats.get("h", 0.0) or 0.0), case.problem
    sizes = np.abs(traj.x).max(axis=1, initial=0.0)
    k = int(np.argmax(sizes))
    if not (isinstance(p, Complementarity) and h > 0.0 and sizes[k] > GREW * max(sizes[0], float(np.median(sizes)))):
        return None
    i, f = int(np.argmax(np.abs(traj.x[k]))), p.drift(np)(float(traj.t[k]), traj.x[k].copy())
    if not -f[i] * h * np.sign(traj.x[k, i]) > 2.0 * sizes[k]:
        return None
    return Status("diverged", f"The state grew to {sizes[k]:.3g} at t = {traj.t[k]:.6g} although the drift pulls it back: steps "
                              f"of {h:.3g} overshoot; take them shorter than {2.0 * sizes[k] / abs(f[i]):.3g}.")


def _rounded(case: Case, traj: Trajectory) -> Status | None:
    """Steps so many that their roundings, each half a spacing of the state, may add up to a part of the motion.

    The motion is that of the samples, or what the drift would make of the time, if that is more: a state may be held.
    """
    lost = float(traj.stats.get("steps", 0)) * 0.5 * EPS * float(np.abs(traj.x).max(initial=0.0))
    if not lost > ROUNDED * float(np.abs(traj.x - traj.x[0]).max(initial=0.0)):
        return None
    speed = max(pace(case.problem, float(t), x) for t, x in zip(traj.t, traj.x, strict=True))
    if not 0.0 < ROUNDED * speed * float(traj.t[-1] - traj.t[0]) < lost:
        return None
    size = np.abs(traj.x).max()
    return Status("unverified", f"The roundings of {int(traj.stats['steps'])} steps of a state of {size:.3g} may add up to "
                                f"{lost:.2g}, which is more than a hundredth of the motion: take longer steps, or a "
                                "frame in which the state is not so large.")


def pace(problem, t: float, x: np.ndarray) -> float:
    """Largest speed that the drift, or a field beside all surfaces, gives to a coordinate."""
    if isinstance(problem, LCS):
        speeds = [problem.A @ x + (problem.u(np)(t) if problem.u else 0.0)]
    elif isinstance(problem, Complementarity):
        speeds = [problem.drift(np)(t, x.copy())]
    else:
        field, d = problem.field(np), len(np.atleast_1d(problem.switch(np)(t, x)))
        speeds = [field(t, x.copy(), np.full(d, s)) for s in (1.0, -1.0)]
    return float(np.abs(speeds).max(initial=0.0))


@functools.lru_cache(maxsize=64)
def _scene(case: Case) -> Scene:
    return Scene(case.problem, case.n)


@functools.lru_cache(maxsize=512)
def _tied(case: Case) -> Status | None:
    """Coincident centres at a start that is kept: which way they part is no property of the case."""
    if case.start != "keep" or not any(isinstance(c, Distance) for c in case.problem.constraints):
        return None
    t, scene = float(case.t[0]), _scene(case)
    near = scene.near(case.x0, 0.0, t)
    g = scene.gaps(t, case.x0, near)
    tie = np.flatnonzero(np.isin(near.kind, (PAIR, ANCHOR)) & (near.sign > 0) & (g == -near.d))
    if not tie.size:
        return None
    return Status("degenerate", f"The start has coincident centres, {near.ids[int(tie[0])]}: their contact has no normal, and "
                                "each method parts them in a direction of its own.")


def _nowhere(case: Case, traj: Trajectory) -> Status | None:
    """Constraints that contradict each other where the run violates them most, or begins to violate them as much."""
    if case.exact is not None or not (case.start == "keep" or any(c.moving for c in case.problem.constraints)):
        return None
    scene = _scene(case)
    depth = np.array([scene.deepest(float(t), x) for t, x in zip(traj.t, traj.x, strict=True)])
    worst = int(np.argmax(depth))
    if depth[worst] <= MISSED * max(1.0, float(np.abs(traj.x[worst]).max())):
        return None
    why = contradiction(case, float(case.t[worst] if scene.moving else case.t[0]))
    first = int(np.argmax(depth >= HALF * depth[worst]))
    for k in dict.fromkeys((worst, first)):
        why = why or _arrangement(scene, float(traj.t[k]), traj.x[k], float(depth[k]))
    return None if why is None else Status("infeasible", why)


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
    return _rows(_scene(case), t) or _links(case, _scene(case), t)


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
                    bounds=[(None, None)] * n + [(0.0, None)])
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


def _flat(case: Case, traj: Trajectory) -> Status | None:
    """A smooth constraint that pushes where its gradient vanishes."""
    if not any(isinstance(c, Smooth) for c in case.problem.constraints):
        return None
    scene, acts = _scene(case), np.abs(np.diff(traj.impulse, axis=0)) > 0.0
    families = [k for k, c in enumerate(scene.families) if isinstance(c, Smooth)]
    for s, k in enumerate(families):
        mine = [(c, ident[1]) for c, ident in enumerate(traj.contacts) if ident[0] == k]
        if not mine:
            continue
        grads = [np.asarray(scene.smooth(s).gradient(t, x)) for t, x in zip(traj.t, traj.x, strict=True)]
        size = np.sqrt((np.array(grads) ** 2).sum(-1))                       # (samples, rows)
        for c, row in mine:
            pushing = np.flatnonzero(acts[:, c] & (np.minimum(size[:-1, row], size[1:, row]) <= FLAT * np.nanmax(size[:, row])))
            if pushing.size:
                return Status("degenerate", f"Constraint {(k, row)} pushes at t = {traj.t[pushing[0] + 1]:.6g} where its "
                                            "gradient vanishes: there is no direction to push in.")
    return None
