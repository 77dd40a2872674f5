"""Carry an error vector through an interval by the linearised flow, and bound the remainder."""

from __future__ import annotations

import numpy as np

from nsbench.error_bars.shadow import boole, doubt

TERMS = 19  # of exp(A) v for |A| <= 1: the rest is below rounding


def residual_size(rho: np.ndarray, H: float) -> float:
    """Return an upper estimate of the integral of |rho|, from rho (5, n) at the quarters."""
    if not len(rho):
        return 0.0
    sizes = np.linalg.norm(rho, axis=1)
    return H * (boole(sizes) + doubt(sizes[:, None]))


class Flow:
    """P delta over an interval of length H, carried on by the flow exp(s A), A = P J P, and by the
    residuals rho (5, n) at its quarters.

    tangent: P (n, n); along: A (n, n).

    start, end (n,): at its ends, bend: how far it may be from the line between them; integral (n,):
    over it; error, lack: bounds of what the formulas of `end` and `integral` leave out.
    """

    def __init__(self, tangent, along, delta: np.ndarray, rho: np.ndarray, H: float):
        rate = H * float(np.linalg.norm(along))
        self.start = tangent @ delta
        self.end = _flow(H * along, self.start)
        self.integral = H * _flow(H * along, self.start, kind=1)
        size = residual_size(rho @ tangent, H)
        bend = size + 0.125 * rate * rate * float(np.linalg.norm(self.start))
        self.bend = np.exp(rate) * bend
        self.error = 0.0
        self.lack = 0.0
        if not len(rho):
            return
        at = rho @ tangent
        total = H * boole(at)
        rough = H * doubt(at)
        # the first moment of rho about the middle, which the formulas leave out, by Boole's rule is
        # 0.089 (at[3] - at[1]) + 0.039 (at[4] - at[0]) times H
        moment = H * float(np.linalg.norm(0.25 * (at[3] - at[1]) + 0.1 * (at[4] - at[0])))
        # residuals are carried on from the middle of the interval
        self.end = self.end + total + 0.5 * H * (along @ total)
        second = max(rate * rate, float(np.expm1(rate)) - rate)  # of the exponential series
        self.error = rough + second * size + rate * moment
        self.integral = self.integral + 0.5 * H * total
        self.lack = H * (0.5 * rough + moment + max(rate, second) * size)


def _flow(A: np.ndarray, v: np.ndarray, kind: int = 0) -> np.ndarray:
    """Return exp(A) v, or with kind 1 the mean of exp(s A) v over 0 <= s <= 1; by the Taylor series
    where that is short."""
    if not (np.any(A) and np.any(v)):
        return v
    parts = 1
    while np.linalg.norm(A) > parts:
        parts *= 2
    part = A / parts
    mean = np.zeros_like(v)
    for _ in range(parts):
        term = v
        v = np.zeros_like(v)
        for k in range(TERMS):
            v = v + term
            mean = mean + term / ((k + 1) * parts)
            term = part @ term / (k + 1)
    return mean if kind else v
