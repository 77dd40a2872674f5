"""Baseline: PBD for discs or balls in a box, with pairs from SciPy's cKDTree, as users write it.

SciPy's cKDTree finds the pairs of a step, numba or numpy projects them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from nsbench.case import Case
from nsbench.compilation.factories import as_numpy
from nsbench.problem import Affine, Complementarity, Distance
from nsbench.solvers.base import Claims, Expect, Run, grid
from nsbench.solvers.common.divergence import ended
from nsbench.solvers.common.initial_state import initial_state
from nsbench.solvers.common.time_grid import samples
from nsbench.trajectory import Resolution, Status, Trajectory

SWEEPS = ("numba", "numpy")
LARGEST_STATE = 1e150  # beyond, squares overflow, and SciPy's tree raises an error
EXPECTS = (
    Expect(
        ("exact_at_grid",),
        "exact",
        "exact",
        "every step of Euler is exact for a drift that is constant in each mode",
    ),
    Expect(
        ("infeasible_start",),
        None,
        None,
        "what a method makes of an infeasible start is its meaning, not its error",
    ),
)


@dataclass(frozen=True)
class KDTree:
    """Explicit Euler, the pairs nearer than d from a k-d tree, one sweep over them, then the box.

    The baseline of pbd for hard discs and balls of one size, with or without walls across
    coordinates. sweep "numba":
    exact projections one after the other, in the order in which the tree lists the pairs. sweep
    "numpy": all projections from the same state, each scaled by 1 / c with c the larger number of
    contacts of its two particles (a Jacobi step; to divide each particle's motion by its own number
    is common too, but is another system in the limit: pushes are then not opposite). margin: by how
    much of d the search goes beyond d. Without one, contacts that the sweep itself makes wait for
    the next step.
    """

    sweep: str = "numba"
    margin: float = 0.0

    accuracy: ClassVar[str] = "h"
    default: ClassVar[float] = 1e-2
    octaves: ClassVar[float] = 3  # of its ladder: a tenth of the time of six, for loops in Python
    claims: ClassVar[Claims] = Claims(state=1.0, impulse=1.0)
    expects: ClassVar[tuple[Expect, ...]] = EXPECTS

    def __post_init__(self):
        if self.sweep not in SWEEPS:
            raise ValueError(f"sweep is {self.sweep!r}; one of {', '.join(SWEEPS)}")
        if not 0.0 <= self.margin < 10.0:
            raise ValueError(f"margin is {self.margin!r}; a part of the distance, from 0 to 10")

    def refuses(self, case: Case) -> str | None:
        p = case.problem
        if not isinstance(p, Complementarity) or not p.constraints:
            return "kdtree projects on hard particles and walls; this case has none."
        hard = [c for c in p.constraints if isinstance(c, Distance)]
        if len(hard) > 1 or any(
            not c.all_pairs or c.d is None or c.start or c.particles(case.n) * c.dim != case.n
            for c in hard
        ):
            return (
                "kdtree takes one family of hard particles of one size that fill the state; "
                "use pbd for anything else."
            )
        if not all(isinstance(c, Distance) or _box(c) for c in p.constraints) or (
            hard and p.constraints[0] is not hard[0]
        ):
            return (
                "kdtree takes particles, then walls at rest across single coordinates; use pbd "
                "for other constraints."
            )
        return None

    def prepare(self, case: Case, h: float) -> Run:
        from nsbench.dynamics.contacts.constraint_set import ConstraintSet

        x0 = initial_state(case, ConstraintSet(case.problem, case.n))
        g = grid(case.t, h)
        f = as_numpy(case.problem.drift)
        walls = _walls(case)
        hard = next((c for c in case.problem.constraints if isinstance(c, Distance)), None)
        project = _sweeper(self, hard)

        def run() -> Trajectory:
            with np.errstate(
                all="ignore"
            ):  # what overflows ends the run, and is told by its status
                return _march(case, x0, g, f, project, walls)

        return run


def _box(c) -> bool:
    return isinstance(c, Affine) and not c.moving and bool(np.all(np.diff(c.indptr) == 1))


def _walls(case):
    """Return low, high (n,) of every coordinate, and where each bound comes from.

    The latter is (family, row, |a|), -1 for none.
    """
    bound = np.stack((np.full(case.n, -np.inf), np.full(case.n, np.inf)))
    where = np.full((2, case.n, 2), -1, np.int64)
    slope = np.ones((2, case.n))
    for k, c in enumerate(case.problem.constraints):
        if isinstance(c, Distance):
            continue
        for row, (i, a) in enumerate(zip(c.indices, c.data, strict=True)):
            side, at = (0, -c.b[row] / a) if a > 0 else (1, -c.b[row] / a)
            if (at > bound[0, i]) if side == 0 else (at < bound[1, i]):
                bound[side, i], where[side, i], slope[side, i] = at, (k, row), abs(a)
    return bound, where, slope


def _sweeper(method, hard):
    """Return a function (x flat) -> pairs (p, 2) and their impulses (p,), which changes x in place.

    None without particles.
    """
    if hard is None:
        return None
    from scipy.spatial import cKDTree

    d = float(hard.d)
    dim = hard.dim
    reach = d * (1.0 + method.margin)
    if method.sweep == "numba":
        from nsbench.solvers.kdtree.kernels.pair_sweep import sweep

        sweep.compile("float64(float64[:, ::1], int64[:, ::1], float64, float64[::1])")
    else:
        sweep = _jacobi

    def project(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        points = x.reshape(-1, dim)
        tree = cKDTree(
            points, compact_nodes=False, balanced_tree=False
        )  # quicker to build, as quick to ask
        pairs = tree.query_pairs(reach, output_type="ndarray")
        impulse = np.empty(len(pairs))
        sweep(points, pairs, d, impulse)
        return pairs, impulse

    return project


def _jacobi(x, pairs, d, impulse):
    i = pairs[:, 0]
    j = pairs[:, 1]
    u = x[i] - x[j]
    r = np.sqrt(np.einsum("ij,ij->i", u, u))
    near = r < d
    n = len(x)
    count = np.bincount(i[near], minlength=n) + np.bincount(j[near], minlength=n)
    impulse[:] = np.where(near, 0.5 * (d - r) / np.maximum(np.maximum(count[i], count[j]), 1), 0.0)
    u *= (impulse / np.where(near, r, 1.0))[:, None]
    for c in range(x.shape[1]):
        x[:, c] += np.bincount(i, u[:, c], n) - np.bincount(j, u[:, c], n)


def _march(case, x0, g, f, project, walls):
    """Integrate from x0 (n,) on the grid g; return the trajectory."""
    (low, high), where, slope = walls
    x = x0.copy()
    n = case.n
    K = len(g.t)
    X = np.full((K, n), np.nan)
    R = np.full((K, n), np.nan)
    push = np.zeros(n)
    wall = np.zeros((2, n))
    X[0] = x
    R[0] = push
    book = _ImpulseTable(K)
    projections = 0
    status = Status()
    for k, steps in enumerate(g.substeps):
        h = (g.t[k + 1] - g.t[k]) / steps
        for s in range(steps):
            last = x
            x = x + h * f(g.t[k] + s * h, x)
            if not np.abs(x).max() <= LARGEST_STATE:
                status = ended(
                    x if np.isfinite(x).all() else last, x0, g.t[k] + (s + 1) * h, g.t[k] + s * h
                )
                break
            before = x.copy()
            if project is not None:
                pairs, impulse = project(x)
                book.add(pairs, impulse)
                projections += np.count_nonzero(impulse)
            inside = np.clip(x, low, high)
            beyond = inside - x
            wall[0] += np.maximum(beyond, 0.0)
            wall[1] -= np.minimum(beyond, 0.0)
            projections += np.count_nonzero(beyond)
            x = inside
            push += x - before
        if not status.ok:
            break
        X[k + 1] = x
        R[k + 1] = push
        book.close(k + 1, wall / slope)
    contacts, W = book.table(where, np.isfinite(X[:, 0]))
    return _trajectory(case, g, X, contacts, W, R, status, int(projections))


def _trajectory(case, g, X, contacts, W, R, status, projections):
    """Return the trajectory of a run from states X, impulses W and reactions R at the times of g.

    The grid g ends steps at the recorded times, or the run is sampled there.
    """
    if not g.aligned:
        X, R, W = samples(case.t, g.t, X, R, W)
    steps = int(g.substeps.sum())
    stats = {
        "steps": steps,
        "h": g.h,
        "drift_calls": steps,
        "projections": projections,
        "loop": "host",
    }
    resolution = Resolution(step=g.h, rule="explicit")
    return Trajectory(
        case.t, X, contacts, W, R, status, stats=stats, lam_time="start", resolution=resolution
    )


class _ImpulseTable:
    """Table of impulses by contact at the recorded times."""

    def __init__(self, K):
        self.K = K
        self.open = []
        self.rows = []
        self.walls = []

    def add(self, pairs: np.ndarray, impulse: np.ndarray) -> None:
        acting = impulse > 0.0
        if acting.any():
            self.open.append((pairs[acting], impulse[acting]))

    def close(self, k: int, wall: np.ndarray) -> None:
        if self.open:
            pairs = np.sort(np.concatenate([p for p, _ in self.open]), axis=1)
            self.rows.append(
                (np.full(len(pairs), k), pairs, np.concatenate([m for _, m in self.open]))
            )
            self.open = []
        self.walls.append((k, wall))

    def table(self, where: np.ndarray, good: np.ndarray) -> tuple[tuple, np.ndarray]:
        """Return contacts and cumulative impulse (K, m), NaN where not `good`."""
        contacts = []
        columns = []
        if self.rows:
            at, pairs, m = (np.concatenate(v) for v in zip(*self.rows, strict=True))
            ids, column = np.unique(pairs, axis=0, return_inverse=True)
            sums = np.bincount(at * len(ids) + column.ravel(), m, self.K * len(ids)).reshape(
                self.K, len(ids)
            )
            contacts += [(0, int(i), int(j)) for i, j in ids]
            columns.append(np.cumsum(sums, axis=0))
        total = np.zeros((self.K, *where.shape[:2]))
        for k, wall in self.walls:
            total[k] = wall
        for side, i in zip(*np.nonzero((total > 0.0).any(axis=0)), strict=True):
            contacts.append(tuple(map(int, where[side, i])))
            columns.append(total[:, side, i][:, None])
        W = np.hstack(columns) if columns else np.zeros((self.K, 0))
        W[~good] = np.nan
        return tuple(contacts), W


SOLVER = KDTree
