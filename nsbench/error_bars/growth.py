"""How errors grow along a motion: derivative of the drift and one-sided Lipschitz constant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.error_bars.drift import Drift
from nsbench.error_bars.kernels.error_flow import NUDGE

LOOKS = 5  # states of a run at which the derivative of the drift is taken


@dataclass(frozen=True)
class Linear:
    """Drift near a run: derivative J (n, n), by how much it changes along the run, one-sided and
    two-sided Lipschitz constants (the change included)."""

    J: np.ndarray
    change: float
    one_sided: float
    two_sided: float


def derivatives(drift: Drift, t: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Return (K, n, n) the derivatives of the drift in the state, by central differences."""
    n = X.shape[1]
    J = np.empty((len(t), n, n))
    for k, (s, x) in enumerate(zip(t, X, strict=True)):
        steps = NUDGE * np.maximum(1.0, np.abs(x))
        moved = np.diag(steps)
        values = drift.at(np.full(2 * n, s), np.concatenate([x + moved, x - moved]))
        J[k] = ((values[:n] - values[n:]) / (2.0 * steps[:, None])).T
    return J


def linear_drift(drift: Drift, t: np.ndarray, X: np.ndarray) -> Linear:
    """Return the drift near a run as a linear one, with upper estimates of its constants.

    Its derivative is that of the middle of LOOKS states of the run; the constants are the largest
    of these states, enlarged by how much the derivative changes between them: nothing for a drift
    that is affine in the state.
    """
    at = np.unique(np.linspace(0, len(t) - 1, LOOKS).astype(int))
    J = derivatives(drift, t[at], X[at])
    symmetric = 0.5 * (J + J.transpose(0, 2, 1))
    # of a derivative: rounding of the differences
    rounding = 1e-8 * (1.0 + float(np.abs(J).max()))
    middle = J[len(J) // 2]
    change = max(float(np.linalg.norm(A - middle, 2)) for A in J)
    # the derivative may change as much again between the states that were looked at
    change = rounding if change < rounding else 2.0 * change
    one_sided = max(float(np.linalg.eigvalsh(A)[-1]) for A in symmetric)
    two_sided = max(float(np.linalg.norm(A, 2)) for A in J)
    return Linear(middle, change, one_sided + change, two_sided + change)
