"""Distance to the set of multipliers {mu >= 0, G^T mu = r, supp mu in A}, where not unique.

Distance to the set, and its least-norm point.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from nsbench.measure.context import MeasureContext, near_of, tolerance
from nsbench.reference import canonical
from nsbench.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class Polyhedron:
    """Set of multipliers mu = base + Z y, mu >= -slack.

    base (m,): the least-squares solution of G^T mu = r; Z (m, z): null space of G^T.
    """

    base: np.ndarray
    Z: np.ndarray
    slack: float

    def nearest(self, lam: np.ndarray) -> np.ndarray | None:
        """Return the point of the set nearest to lam (m,), None if the set is empty.

        Within the affine hull the free optimum is y0 = Z^T (lam - base); what is left is a
        least-distance problem min |z|, Z z >= -(base + Z y0) - slack, solved as a non-negative
        least-squares problem (Lawson & Hanson 1974, chapter 23).
        """
        from scipy.optimize import nnls

        y = self.Z.T @ (lam - self.base)
        need = -(self.base + self.Z @ y) - self.slack
        if np.all(need <= 0.0):
            return self.base + self.Z @ y
        if not self.Z.shape[1]:
            return None
        # scaled so that the right-hand side is of the size of Z: the distance is the scale times
        # the solution's
        size = float(np.abs(need).max())
        E = np.vstack([self.Z.T, need[None] / size])
        rhs = np.append(np.zeros(self.Z.shape[1]), 1.0)
        u, _ = nnls(E, rhs, maxiter=30 * E.shape[1])
        r = E @ u - rhs
        if abs(r[-1]) < 1e-10:
            return None
        return self.base + self.Z @ (y - size * r[:-1] / r[-1])


def polyhedron(G: np.ndarray, r: np.ndarray, slack: float, rank: float = 1e-10) -> Polyhedron:
    """Build the set from the gradients G (m, n) of the active contacts and the reaction r (n,)."""
    U, s, Vt = np.linalg.svd(G.T, full_matrices=True)
    k = int(np.count_nonzero(s > rank * s[0])) if s.size else 0
    base = Vt[:k].T @ ((U[:, :k].T @ r) / s[:k])
    return Polyhedron(base, Vt[k:].T, slack)


def resting(frame: MeasureContext) -> list:
    """Find the intervals where the reference has one set of contacts and constant gradients.

    Constant: the gradients at both ends differ by no more than the gap tolerance. Returns a list of
    (interval, ids, polyhedron, least); least: the least-norm multiplier.
    """
    if "resting" not in frame.cache:
        frame.cache["resting"] = list(_resting(frame))
    return frame.cache["resting"]


def _resting(frame: MeasureContext) -> Iterator[tuple]:
    """Yield what `resting` lists."""
    case = frame.case
    ref = frame.ref
    scene = frame.scene
    tol = tolerance(ref)
    events = np.array([e.t for e in ref.events or ()])
    for k in range(len(case.t) - 1):
        ids = frame.active[k]
        inside = np.any((events > case.t[k] + tol) & (events < case.t[k + 1] - tol))
        if not ids or ids != frame.active[k + 1] or inside:
            continue
        near = near_of(scene, ids)
        G, H = (scene.gradients(float(case.t[j]), ref.x[j], near) for j in (k, k + 1))
        if abs(G - H).max() > tol:
            continue
        used = np.unique(G.indices)
        dt = case.t[k + 1] - case.t[k]
        r = (ref.reaction[k + 1] - ref.reaction[k]) / dt
        size = max(1.0, float(np.abs(r).max()))
        found = polyhedron(
            G[:, used].toarray(), r[used], 1e-9 * size + 10 * ref.reaction_error / dt
        )
        least = found.nearest(np.zeros(len(ids)))
        if least is not None:
            yield k, ids, found, least


def selection(frame: MeasureContext, traj: Trajectory) -> tuple[float, float]:
    """Measure the distance of lambda to the least-norm multiplier and to the set of multipliers.

    The largest Euclidean distances of its interval means; the first is the selection of the method,
    never an error. NaN where no interval has constant contacts and gradients.
    """
    worst = [np.nan, np.nan]
    column = {canonical(frame.case.problem, c): k for k, c in enumerate(traj.contacts)}
    for k, ids, found, least in resting(frame):
        mean = (traj.impulse[k + 1] - traj.impulse[k]) / (frame.case.t[k + 1] - frame.case.t[k])
        at = [column.get(c) for c in ids]
        lam = np.array([0.0 if a is None else mean[a] for a in at])
        other = np.delete(mean, [a for a in at if a is not None])  # must be zero
        mu = found.nearest(lam)
        if mu is not None:
            for j, point in enumerate((least, mu)):
                worst[j] = np.fmax(worst[j], np.sqrt(np.sum((lam - point) ** 2) + other @ other))
    return float(worst[0]), float(worst[1])
