"""How errors grow along a motion: derivative of the drift and one-sided Lipschitz constant."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from nsbench.dynamics.interval_taylor import SPACE, as_jet, enclosing
from nsbench.error_bars.drift import Drift
from nsbench.error_bars.kernels.error_flow import NUDGE

LOOKS = 5  # states of a run at which the derivative of the drift is taken


@dataclass(frozen=True)
class Linear:
    """Drift near a run: derivative J (n, n), by how much it changes along the run, one-sided and
    two-sided Lipschitz constants (the change included). boxes: the same in the boxes of a tube, if
    the derivative changes between them, and box (K - 1,): that of each interval of the run. low,
    high (n,): of such a box the states for which they hold, else of any.
    is_proven: do they hold wherever they were enclosed, or is the change a guess from LOOKS states?
    """

    J: np.ndarray
    change: float
    one_sided: float
    two_sided: float
    boxes: tuple[Linear, ...] = ()
    box: np.ndarray = field(default_factory=lambda: np.empty(0, int))
    is_proven: bool = False
    low: float | np.ndarray = -np.inf
    high: float | np.ndarray = np.inf

    def holds_at(self, X: np.ndarray) -> bool:
        """Do the constants hold between all of these states (K, n)?"""
        return bool(np.all(self.low <= X) and np.all(X <= self.high))

    def at(self, j: int) -> Linear:
        """Return the drift in interval j."""
        return self.boxes[self.box[j]] if self.boxes else self


@dataclass(frozen=True)
class Tube:
    """Boxes around a curve: in the times t (B + 1,) from one to the next, its coordinates lie
    between low and high, each (B, n). box (K - 1,): that of each interval of the run."""

    t: np.ndarray
    low: np.ndarray
    high: np.ndarray
    box: np.ndarray

    def widened(self, radius: float) -> Tube:
        """Return the boxes that hold all states within this distance of the curve."""
        return replace(self, low=self.low - radius, high=self.high + radius)


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
    """Return the drift near a run as a linear one, with estimates of its constants.

    Its derivative is that of the middle of LOOKS states of the run; the constants are the largest
    of these states, enlarged by how much the derivative changes between them: nothing for a drift
    that is affine in the state, with a matrix that does not depend on time.
    """
    at = np.unique(np.linspace(0, len(t) - 1, LOOKS).astype(int))
    J = derivatives(drift, t[at], X[at])
    middle = J[len(J) // 2]
    change = max(float(np.linalg.norm(A - middle, 2)) for A in J)
    # the derivative may change as much again between the states that were looked at
    return _with_change(middle, J, 0.0 if change < _rounding(J) else 2.0 * change)


def enclosed_drift(linear: Linear, drift: Drift, tube: Tube) -> Linear:
    """Return the same with constants that hold in a tube around the run.

    By interval Taylor arithmetic; `linear` itself where the drift cannot be enclosed.
    """
    enclosed = _derivative_in(drift, tube)
    if enclosed is None:
        return linear
    mid, rad = enclosed
    unsure = np.linalg.norm(rad, axis=(1, 2))
    off = np.linalg.norm(mid - linear.J, 2, axis=(1, 2)) + unsure
    if off.max() < _rounding(linear.J):
        return replace(linear, is_proven=True)
    if not np.all(np.isfinite(off)):
        return linear
    found = _with_change(linear.J, mid, float(off.max()))
    boxes = [
        replace(_with_change(J, J[None], change), low=low, high=high)
        for J, change, low, high in zip(mid, unsure, tube.low, tube.high, strict=True)
    ]
    return replace(found, boxes=tuple(boxes), box=tube.box, is_proven=True)


def _with_change(middle: np.ndarray, J: np.ndarray, change: float) -> Linear:
    """Return the constants of derivatives J (K, n, n) that change by so much beside `middle`."""
    change = max(change, _rounding(J))
    symmetric = 0.5 * (J + J.transpose(0, 2, 1))
    one_sided = max(float(np.linalg.eigvalsh(A)[-1]) for A in symmetric)
    two_sided = max(float(np.linalg.norm(A, 2)) for A in J)
    return Linear(middle, change, one_sided + change, two_sided + change)


def _rounding(J: np.ndarray) -> float:
    """Rounding of a derivative that is taken by differences."""
    return 1e-8 * (1.0 + float(np.abs(J).max()))


def _derivative_in(drift: Drift, tube: Tube) -> tuple[np.ndarray, np.ndarray] | None:
    """Enclose the derivative of the drift in the state by mid +- rad, each (K, n, n), in each box
    of a tube; None where a function is not written in a way that Jets follow."""
    K, n = tube.low.shape
    origin, time, length = drift.units
    t = origin + time * tube.t
    mid = np.empty((K, n, n))
    rad = np.empty((K, n, n))
    try:
        f = drift.factory(SPACE)
        moment = enclosing(0.5 * (t[1:] + t[:-1]), 0.5 * np.abs(np.diff(t)))
        box = length * 0.5 * (tube.low + tube.high).T, length * 0.5 * (tube.high - tube.low).T
        for k in range(n):
            state = enclosing(*box)
            state.mid[k, :, 1] = 1.0
            found = as_jet(f(moment, state), K)
            if found.shape != (n,):
                return None
            mid[:, :, k] = time * found.mid[..., 1].T
            rad[:, :, k] = time * found.rad[..., 1].T
    except (TypeError, ValueError, AttributeError, IndexError, NotImplementedError):
        return None
    return mid, rad
