"""What is known of a run between its samples: states that methods keep there, for doubts that
samples do not show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nsbench.trajectory import Trajectory

LOOKS = 100  # parts of a run with switches after which states are kept
CLOSE = 1e-6  # of the run: nearer to one another weights between two states are rounding


def fuller(traj: Trajectory) -> Trajectory:
    """The run with what is known between its samples as samples; but for the reaction, which
    Filippov systems have not."""
    if traj.between is None or not len(traj.between[0]):
        return traj
    t, x, impulse = traj.between
    span = CLOSE * (traj.t[-1] - traj.t[0])
    later = np.minimum(np.searchsorted(traj.t, t), len(traj.t) - 1)
    away = np.minimum(np.abs(t - traj.t[later]), np.abs(t - traj.t[later - 1])) > span
    away[1:] &= np.diff(t) > span
    t, x, impulse = (
        np.append(a, b[away], axis=0)
        for a, b in zip((traj.t, traj.x, traj.impulse), (t, x, impulse), strict=True)
    )
    order = np.argsort(t)
    return replace(traj, t=t[order], x=x[order], impulse=impulse[order], between=None)


def ways(t: np.ndarray, X: np.ndarray):
    """Time, or times (k,), -> the state (n,), or (n, k), on the straight ways between those that
    are known."""
    return lambda at: np.array([np.interp(at, t, column) for column in X.T])
