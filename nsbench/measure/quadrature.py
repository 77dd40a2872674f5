"""Quadrature over sample intervals of a function known at the samples, with error estimates.

The function is known at the k samples alone: no bound of its error can be had from them. Both
estimates assume that it moves between samples as it does from sample to sample nearby.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

NODES = 6
SPIKE = 4.0  # times the changes of slope nearby: one that is a kink or jump


def kinked_intervals(t: np.ndarray, changed: np.ndarray, events: Iterable[float]) -> np.ndarray:
    """Mark the intervals (k - 1,) inside which x' may jump, as a mask.

    Those on both sides of a change of pattern, and those with an event. t (k,): the samples;
    changed (k - 2,): mask of the inner samples, between whose two intervals the pattern changes;
    events: times.
    """
    kinked = np.zeros(len(t) - 1, bool)
    kinked[:-1] |= changed
    kinked[1:] |= changed
    for e in events:
        kinked[(t[:-1] <= e) & (e <= t[1:])] = True
    return kinked


def integrals(t: np.ndarray, F: np.ndarray, kinked: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Integrate F (k, n) over the intervals of t (k,).

    kinked (k - 1,): mask of the intervals inside which F may jump or have a kink. Returns the
    integrals (k - 1, n) and estimates (k - 1, n) of their error.

    In a smooth stretch: the polynomial through up to six samples around the interval, which reaches
    no kinked one; estimate: the largest change around when an end node is left out (order six,
    judged as if five).

    Else the trapezoid; estimate: L D^2 / 4. It would be a bound with L >= |F'|; for L stands the
    largest slope of a chord between samples, over this interval and the two on each side (before
    and after a kink F moves as it does there).

    So it is also where the samples of F show a kink or a jump (`torn_intervals`: a field with abs,
    sign, floor or where); half of the change of F times D is added to the estimate, which is the
    error at most if F is monotone there and, as the trapezoid's, of a jump beside a sample.
    """
    D = np.diff(t)[:, None]
    value = 0.5 * D * (F[1:] + F[:-1])
    estimate = 0.25 * D**2 * around(np.abs(np.diff(F, axis=0)) / D)
    torn = torn_intervals(t, F)
    estimate += 0.5 * D * np.abs(np.diff(F, axis=0)) * torn
    kinked = kinked | torn.any(axis=1)
    smooth = np.zeros_like(estimate)
    # rounding of t + dt leaves spacings that differ in their last digits; to the rule they are
    # equal
    weights: dict = {}
    for k in np.flatnonzero(~kinked):
        lo = k
        hi = k + 1
        while hi - lo + 1 < NODES:
            left = lo > 0 and not kinked[lo - 1]
            right = hi < len(t) - 1 and not kinked[hi]
            if not (left or right):
                break
            if left and (not right or k - lo <= hi - k - 1):
                lo -= 1
            else:
                hi += 1
        if hi - lo < 2:
            continue
        dt = t[k + 1] - t[k]
        s = (t[lo : hi + 1] - t[k]) / dt
        key = tuple(np.round(s, 9))
        if key not in weights:
            weights[key] = _weights(s), _weights(s[:-1]), _weights(s[1:])
        w, left, right = weights[key]
        G = F[lo : hi + 1]
        value[k] = dt * (w @ G)
        smooth[k] = np.abs(value[k] - dt * (left @ G[:-1])) + np.abs(
            value[k] - dt * (right @ G[1:])
        )
        estimate[k] = 0.0
    # the change passes through zero where a derivative does; its neighbours do not
    return value, np.where(estimate == 0.0, around(smooth), estimate)


def torn_intervals(t: np.ndarray, F: np.ndarray) -> np.ndarray:
    """Mark the intervals in which F (k, n) jumps or has a kink, as its samples show, (k - 1, n).

    Where the change of its slope from interval to interval is SPIKE times as large as all others
    two and three samples away, on both sides of that sample: of a smooth F that the samples
    resolve, none is. At the ends there is nothing to compare with.
    """
    torn = np.zeros((len(t) - 1, F.shape[1]), bool)
    bend = np.abs(np.diff(np.diff(F, axis=0) / np.diff(t)[:, None], axis=0))
    k = len(bend)
    away = [s for s in (-3, -2, 2, 3) if k > abs(s)]
    if not away:
        return torn
    at = np.arange(k)
    others = [np.where(((at + s) % k == at + s)[:, None], bend[(at + s) % k], 0.0) for s in away]
    least = 1e-9 * np.abs(F).max(axis=0, initial=0.0) / np.diff(t).min()
    spike = bend > np.maximum(SPIKE * np.max(others, axis=0), least)
    torn[:-1] |= spike
    torn[1:] |= spike
    return torn


def around(values: np.ndarray) -> np.ndarray:
    """Take for every interval the largest of `values` (k, ...) in it and the two on each side."""
    at = np.arange(len(values))
    return np.max([values[np.clip(at + s, 0, len(values) - 1)] for s in range(-2, 3)], axis=0)


def _weights(s: np.ndarray) -> np.ndarray:
    """Return the weights of the rule on nodes s that is exact for polynomials, on [0, 1]."""
    powers = np.arange(len(s))
    return np.linalg.solve(s[None, :] ** powers[:, None], 1.0 / (powers + 1.0))
