"""Carry an error vector through an interval by the linearised flow, and bound the remainder."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from nsbench.error_bars.contact_rows import size
from nsbench.error_bars.shadow import boole, doubt, upper_mean

TERMS = 19  # of exp(A) v for |A| <= 1
SMALL = 2.0**-56  # of v: terms below are rounding
LONG = 8.0  # norm from which the series takes too many parts


def residual_size(rho: np.ndarray, H: float) -> float:
    """Return an upper estimate of the integral of |rho|, from rho (5, n) at the quarters."""
    if not len(rho):
        return 0.0
    return H * upper_mean(np.sqrt((rho * rho).sum(axis=1)))


class Flow:
    """P delta over an interval of length H, carried on by the flow exp(s A), A = P J P, and by the
    residuals rho (5, n) at its quarters.

    tangent: P (n, n); along: A (n, n); speed: |A|.

    start, end (n,): at its ends, bend: how far it may be from the line between them; integral (n,):
    over it; error, lack: bounds of what the formulas of `end` and `integral` leave out.
    """

    def __init__(
        self, tangent, along, speed: float, delta: np.ndarray, rho: np.ndarray, H: float
    ):
        rate = H * speed
        self.start = tangent @ delta
        self.end, mean = _flow(H * along, rate, self.start)
        self.integral = H * mean
        at = rho @ tangent
        whole = residual_size(at, H)
        bend = whole + 0.125 * rate * rate * size(self.start)
        self.bend = np.exp(rate) * bend
        self.error = 0.0
        self.lack = 0.0
        if not len(rho):
            return
        total = H * boole(at)
        rough = H * doubt(at)
        # the first moment of rho about the middle, which the formulas leave out, by Boole's rule is
        # 0.089 (at[3] - at[1]) + 0.039 (at[4] - at[0]) times H
        moment = H * size(0.25 * (at[3] - at[1]) + 0.1 * (at[4] - at[0]))
        # residuals are carried on from the middle of the interval
        self.end = self.end + total + 0.5 * H * (along @ total)
        second = max(rate * rate, np.expm1(rate) - rate)  # of the exponential series
        self.error = rough + second * whole + rate * moment
        self.integral = self.integral + 0.5 * H * total
        self.lack = H * (0.5 * rough + moment + max(rate, second) * whole)


def _flow(A: np.ndarray, norm: float, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return exp(A) v and the mean of exp(s A) v over 0 <= s <= 1; norm: of A, or more.

    By the Taylor series where it is short, else by scaling and squaring of a matrix that holds
    both. Raises ArithmeticError where the norm is not finite.
    """
    if norm == 0.0 or not v.any():
        return v, v
    if not np.isfinite(norm):
        raise ArithmeticError("the derivative of the drift is not finite")
    if norm > LONG:
        both = np.zeros((len(v) + 1, len(v) + 1))
        both[:-1, :-1] = A
        both[:-1, -1] = v
        both = expm(both)
        return both[:-1, :-1] @ v, both[:-1, -1]
    parts = 1
    while norm > parts:
        parts *= 2
    part = A / parts
    terms = _terms(norm / parts)
    mean = np.zeros_like(v)
    for _ in range(parts):
        term = v
        v = np.zeros_like(v)
        for k in range(terms):
            v = v + term
            mean = mean + term / ((k + 1) * parts)
            term = part @ term / (k + 1)
    return v, mean


def _terms(norm: float) -> int:
    """Return how many terms of exp(A) there are before the rest is below rounding, |A| <= 1."""
    term = 1.0
    k = 0
    while term > SMALL and k < TERMS:
        k += 1
        term *= norm / k
    return max(k, 1)
