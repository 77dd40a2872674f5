"""Distance of a velocity to Filippov's set, the convex hull of the fields around a surface."""

from __future__ import annotations

import numpy as np


def distance_to_hull(v: np.ndarray, points: np.ndarray) -> float:
    """Compute the Euclidean distance of v to the convex hull of points.

    v (n,), points (k, n).
    """
    if len(points) == 1:
        return float(np.linalg.norm(v - points[0]))
    if len(points) == 2:
        edge = points[1] - points[0]
        w = np.clip((v - points[0]) @ edge / max(edge @ edge, 1e-300), 0.0, 1.0)
        return float(np.linalg.norm(v - points[0] - w * edge))
    from scipy.optimize import nnls

    from_v = points - v
    size = float(np.abs(from_v).max())
    if size == 0.0:
        return 0.0
    # weights that sum to one by a heavy row; the sum is then made one exactly
    w, _ = nnls(
        np.vstack([from_v.T / size, np.full(len(points), 1e4)]), np.append(np.zeros(len(v)), 1e4)
    )
    return _refined(w / w.sum(), from_v)


def _refined(w: np.ndarray, from_v: np.ndarray) -> float:
    """Compute the distance that weights of points leave.

    The weights are corrected for the rounding of the heavy row.
    """
    least = np.inf
    # Active set: least squares on the points of positive weight; negative weights are dropped.
    while w.any():
        w, from_v = w[w > 0.0] / w.sum(), from_v[w > 0.0]
        least = min(least, float(np.linalg.norm(w @ from_v)))
        u = np.linalg.lstsq((from_v[1:] - from_v[0]).T, -w @ from_v, rcond=None)[0]
        w = w + np.append(-u.sum(), u)
        if np.all(w >= 0.0):
            return min(least, float(np.linalg.norm(w @ from_v)))
        w = np.maximum(w, 0.0)
    return least
