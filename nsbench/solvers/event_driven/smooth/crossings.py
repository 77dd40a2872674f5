"""Locate the first event on a step: downward crossings of functions at the nodes of its pieces.

Every function is interpolated by a Chebyshev series on every piece; pieces are halved until the
series is resolved. A dip below zero and back inside one piece is found as two roots of the series.
A dip that stays within `touch` of zero is a touch, not an event: its depth is rounding, and the
motion after it is the same to rounding with and without it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.polynomial import chebyshev

from nsbench.solvers.event_driven.smooth.pieces import (
    DEGREE,
    NODES,
    TO_CHEBYSHEV,
    Piece,
    single_piece,
)

MAX_SPLITS = 12  # halvings of a piece before a function counts as not smooth
TOUCH = 0.05  # part of the band that a dip must exceed to be a crossing
# Slope in touches per piece: a function that leaves a piece below zero this steeply has crossed.
CROSSING_SLOPE = 100.0
_SCAN = chebyshev.chebvander(np.linspace(-1.0, 1.0, 33), DEGREE)
_END = np.arange(DEGREE + 1.0) ** 2  # slope of the Chebyshev polynomials at 1
_MINIMAL = 16 * np.finfo(float).eps


class EventFunctions:
    """Event functions of one arc, gaps(t, y) -> (m,), with their levels and armed masks.

    An armed function fires where it crosses zero downward; one that is not armed fires where it
    falls below its level, and is armed once it exceeds its band. touches: dips that are no event.
    """

    def __init__(self, gaps: Callable, band, armed, t: float, y: np.ndarray):
        g = np.asarray(gaps(t, y), float)
        self.gaps = gaps
        self.touches = 0
        self.finite = bool(np.all(np.isfinite(g)))
        self.band = np.broadcast_to(np.asarray(band, float), g.shape)
        self.armed = g > self.band if armed is None else np.array(armed, bool)
        self.level = np.where(self.armed, 0.0, np.minimum(g, 0.0) - self.band)
        self.touch = TOUCH * self.band

    def first(self, dense: Callable, pieces: list[Piece]):
        """Return (time, index, slope) of the first event on the pieces, or None."""
        # Depth-first bisection of the pieces, in order, until each function is resolved.
        todo = [(p, 0) for p in reversed(pieces)]
        while todo:
            piece, depth = todo.pop()
            values = np.array([self.gaps(s, y) for s, y in zip(piece.times, piece.y, strict=True)])
            c = TO_CHEBYSHEV @ values
            tail = np.abs(c[-2:]).sum(axis=0)
            swing = np.abs(c[1:]).sum(axis=0)
            near = ~(c[0] - swing - tail > np.where(self.armed, 0.0, self.level))
            rough = (
                near
                & (tail > 1e-4 * swing)
                & (tail > 1e-3 * self.band)
                & (swing > 1e-15 * np.abs(values).max(initial=0.0))
            )
            lowest = (_SCAN @ c).min(
                axis=0, initial=np.inf
            )  # a dip this near to zero needs the last digit
            rough |= near & (tail > self.touch) & (np.abs(lowest) <= 100.0 * tail + 4e-3 * swing)
            if (
                rough.any()
                and depth < MAX_SPLITS
                and piece.hi - piece.lo > 64 * np.spacing(abs(piece.hi))
            ):
                mid = 0.5 * (piece.lo + piece.hi)
                todo += [
                    (single_piece(dense, mid, piece.hi, piece.depth + 1, piece.proven), depth + 1),
                    (single_piece(dense, piece.lo, mid, piece.depth + 1, piece.proven), depth + 1),
                ]
                continue
            base = np.where(self.armed, 0.0, self.level)
            dips = near & (rough | (lowest - base <= 100.0 * tail + 4e-3 * swing + self.touch))
            hits = [
                (*hit, int(i))
                for i in np.flatnonzero(dips)
                if (hit := self._crossing(i, c[:, i], values[:, i]))
            ]
            if hits:
                s, lefts, right, target, i = min(hits)
                to_time = piece.time_at
                slope = chebyshev.chebval(s, chebyshev.chebder(c[:, i])) * 2 / (piece.hi - piece.lo)
                self.level[i] = target
                lefts = [to_time(u) for u in lefts]
                return (
                    self._root(dense, i, lefts, to_time(s), to_time(right), piece.hi),
                    i,
                    float(slope),
                )
            rose = ~self.armed & (values > self.band).any(axis=0)
            self.armed |= rose
            self.level[rose] = 0.0
        return None

    def _crossing(self, i, c, values):
        """Return (s, lefts, right, target) of the first event of function i on [-1, 1], or None.

        s: its place. lefts: left ends of brackets, that may be above, the nearest first.
        """
        if self.armed[i]:
            return self._downward(c, values, -1.0, 0.0, self.touch[i], True)
        fall = self._downward(c, values, -1.0, self.level[i], 0.0)
        rise = next((a for a, _ in _below(_constant_series(self.band[i]) - c, -1.0)), None)
        if rise is None or (fall is not None and fall[0] <= rise):
            return fall
        return self._downward(c, values, rise, 0.0, self.touch[i], True)

    def _downward(self, c, values, start, target, touch, count=False):
        """Find the first crossing of `target` after `start` that goes `touch` below it."""
        dip = next(iter(_below(c - _constant_series(target - touch), start)), None)
        if (
            dip is None
            and chebyshev.chebval(1.0, c) < target
            and _END @ c < -CROSSING_SLOPE * touch
        ):
            dip = 1.0, 1.0  # it is on its way down when the piece ends
        if dip is None:
            k = np.flatnonzero(
                (values < target - touch) & (start < NODES)
            )  # the series may be unresolved
            if k.size and start == -1.0:
                return NODES[k[0]], (NODES[max(k[0] - 1, 0)],), NODES[k[0]], target
            if count and values.min() < target - 1e-3 * touch and start == -1.0:
                self.touches += 1
            return None
        below = _below(c - _constant_series(target), start)
        s = next(
            (a for a, b in below if a <= dip[0] <= b), dip[0]
        )  # a root that rounding puts behind the dip is at it
        turns = _roots(chebyshev.chebder(c))[::-1]  # from the last one on it only falls to s
        lefts = tuple(0.5 * (s + u) for u in (*turns[(turns > start) & (turns < s)], start))
        return s, lefts, 0.5 * (dip[0] + dip[1]), target

    def _root(self, dense, i, lefts, guess, right, end):
        """Solve for the time of the event on the dense output by Brent's method."""
        from scipy.optimize import brentq

        values = {}

        def fun(s: float) -> float:
            values[s] = float(self.gaps(s, dense(s))[i]) - self.level[i]
            return values[s]

        if not lefts[-1] < right and fun(right) > self.band[i]:
            # it jumps between floats that are one to the polynomial
            lefts = [right]
            right = end
        left = next((u for u in lefts if u < right and fun(u) > 0.0), None)
        if left is None:
            return guess
        if fun(right) >= 0.0:
            if not (values[right] > self.band[i] and right < end and fun(end) < 0.0):
                return guess
            right = end
        # a root of higher order takes more than the usual hundred iterations
        root = brentq(
            fun, left, right, xtol=4 * np.spacing(abs(right)), rtol=_MINIMAL, maxiter=10_000
        )
        return root if values[root] <= self.band[i] else _jump(fun, root, right)


def _jump(fun, left, right):
    """Return the first time after a jump to below zero, by bisection to adjacent doubles."""
    while left < (mid := 0.5 * (left + right)) < right:
        left, right = (mid, right) if fun(mid) > 0.0 else (left, mid)
    return right


def _constant_series(level):
    """Return the Chebyshev series of a constant."""
    return np.eye(1, DEGREE + 1)[0] * level


def _roots(c) -> np.ndarray:
    """Return the real roots of the series on [-1, 1], sorted."""
    c = np.trim_zeros(c, "b")
    roots = chebyshev.chebroots(c) if len(c) > 1 else np.empty(0)
    return np.sort(roots.real[(roots.imag == 0.0) & (np.abs(roots.real) <= 1.0 + 1e-12)]).clip(
        -1.0, 1.0
    )


def _below(c, start) -> list[tuple[float, float]]:
    """List the intervals (begin, end) of [start, 1] on which the series is negative, in order."""
    roots = _roots(c)
    edges = np.unique(np.concatenate([[start], roots[roots > start], [1.0]]))
    negative = chebyshev.chebval(0.5 * (edges[1:] + edges[:-1]), c) < 0.0
    changes = np.flatnonzero(np.diff(negative.astype(int), prepend=0, append=0))
    return list(zip(edges[changes[::2]].tolist(), edges[changes[1::2]].tolist(), strict=True))
