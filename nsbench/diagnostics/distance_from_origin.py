"""Runs far from the origin, where a relative tolerance is one of coordinates and not of what
moves."""

from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.diagnostics.diagnose import largest_speed

FAR = 1e3  # sizes of the motion from the origin: as near, tolerances are said to be of the motion
HALF = 0.5  # of a run: what grows later has grown from errors of the time before


def distance_over_motion(case: Case, X: np.ndarray) -> float:
    """How many sizes of its motion, or of 1 if that is more, a run of samples X (K, n) is from the
    origin, in its first half or the whole of it; 1 if no more than FAR. Coordinates at rest are
    known as well as at the start and do not count."""
    moved = np.abs(X - X[0])
    size = np.abs(X)[:, np.any(X != X[0], axis=0)]
    half = HALF * (case.t[-1] - case.t[0])
    early = case.t - case.t[0] <= half
    # where no sample is there, what it would be at the pace of the start
    way = (
        moved[early].max()
        if early.sum() > 1
        else min(moved.max(), half * largest_speed(case.problem, float(case.t[0]), case.x0))
    )
    far = max(
        size[k].max(initial=1.0) / max(1.0, float(w))
        for k, w in ((early, way), (slice(None), moved.max()))
    )
    return float(far) if far > FAR else 1.0
