"""Cut a step into pieces on which everything is known to be smooth, by proof where that can be had.

The black boxes of a case (drift, moving walls, smooth constraints) are enclosed along the
polynomial that the integrator gives for the step, with all derivatives up to the ninth (see
nsbench.solvers.event_driven.interval_taylor). Interpolation at NODES of a piece of radius r is then
off by at most  |q^(9)| r^9 / 9! / 2^7  (Davis 1963, theorem 3.1.1, with the Chebyshev extrema as
nodes), and nothing narrower than the piece hides in it. Pieces are halved until that bound is
small.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nsbench.solvers.event_driven.interval_taylor import ORDER, as_jet, clock, path

DEGREE = ORDER - 1  # of the interpolants: one more than the dense output of DOP853
RESOLVED = (
    1e-10  # bound on interpolation of the data, relative to their size, that counts as smooth
)
DEPTH = 19  # halvings: features of 2e-6 of a step are resolved, narrower ones are left open
CROWDED = 64  # unresolved pieces of one size: beyond, proofs cost more than they are worth

_ANGLES = np.pi * np.arange(DEGREE + 1) / DEGREE
NODES = -np.cos(_ANGLES)
TO_CHEBYSHEV = np.linalg.inv(np.polynomial.chebyshev.chebvander(NODES, DEGREE))
TO_POWERS = (
    np.array(
        [
            np.pad(np.polynomial.chebyshev.cheb2poly(row), (0, DEGREE + 1))[: DEGREE + 1]
            for row in np.eye(DEGREE + 1)
        ]
    ).T
    @ TO_CHEBYSHEV
)
TO_SLOPES = np.linalg.inv(np.vander(NODES, increasing=True))
TO_SLOPES = np.vander(NODES, increasing=True)[:, :-1] @ (
    np.arange(1, DEGREE + 1)[:, None] * TO_SLOPES[1:]
)
HALF = 1.0 / 2.0 ** (DEGREE - 1)


@dataclass(frozen=True)
class Piece:
    """[lo, hi] with the path at its NODES, y (9, n). depth: halvings. proven: nothing narrower
    hides in it."""

    lo: float
    hi: float
    y: np.ndarray
    depth: int
    proven: bool

    @property
    def times(self) -> np.ndarray:
        return nodes(self.lo, self.hi)

    def slopes(self) -> np.ndarray:
        """(9, n) derivative of the path at the nodes."""
        return TO_SLOPES @ self.y * (2.0 / (self.hi - self.lo))


def nodes(lo: float, hi: float) -> np.ndarray:
    times = 0.5 * (lo + hi) + 0.5 * (hi - lo) * NODES
    times[0] = lo
    times[-1] = hi
    return times


def single_piece(
    dense: Callable, lo: float, hi: float, depth: int = 0, proven: bool = False
) -> Piece:
    return Piece(lo, hi, dense(nodes(lo, hi)).T, depth, proven)


def split_where_smooth(
    dense: Callable, lo: float, hi: float, data: Callable | None
) -> list[Piece] | None:
    """Pieces from lo to hi in order; data(t, y) gives the black boxes for Jets. None: nothing can
    be proven."""
    if data is None:
        return None
    done = []
    open_ = [single_piece(dense, lo, hi)]
    size = (1.0 + np.abs(open_[0].y).max(initial=0.0)) / max(
        hi - lo, 1.0
    )  # as a length, and as a speed over the step
    for depth in range(DEPTH + 1):
        smooth = _smooth(open_, data, RESOLVED * size)
        if smooth is None:
            return None
        done += [
            Piece(p.lo, p.hi, p.y, depth, True)
            for p, good in zip(open_, smooth, strict=True)
            if good
        ]
        rest = [p for p, good in zip(open_, smooth, strict=True) if not good]
        if not rest:
            break
        if depth == DEPTH or rest[0].hi - rest[0].lo < 64 * np.spacing(max(abs(lo), abs(hi))):
            done += rest
            break
        if len(rest) > CROWDED:
            return None
        open_ = [
            single_piece(dense, *ends, depth + 1)
            for p in rest
            for ends in ((p.lo, 0.5 * (p.lo + p.hi)), (0.5 * (p.lo + p.hi), p.hi))
        ]
    return sorted(done, key=lambda p: p.lo)


def _smooth(pieces, data, least):
    """(K,) whether the bound is below RESOLVED of the data, or `least`, on each piece; None if data
    take no Jets."""
    ends = np.array([(p.lo, p.hi) for p in pieces])
    c = np.stack([TO_POWERS @ p.y for p in pieces], axis=1)  # (9, K, n)
    try:
        found = [
            as_jet(q, len(pieces))
            for q in data(
                clock(ends.mean(1), 0.5 * (ends[:, 1] - ends[:, 0])),
                path(np.moveaxis(c, 0, -1).transpose(1, 0, 2)),
            )
        ]
    except (TypeError, ValueError, AttributeError, IndexError, NotImplementedError):
        return (
            None  # written for arrays in a way that Jets do not follow: said by the run, not hidden
        )
    good = np.ones(len(pieces), bool)
    for q in found:
        low = np.abs(q.mid[..., 0]) - q.rad[..., 0]  # proven to be reached
        size = np.nanmax(np.where(np.isfinite(low), low, 0.0), initial=0.0)
        bound = (
            (np.abs(q.mid[..., ORDER]) + q.rad[..., ORDER])
            .reshape(-1, len(pieces))
            .max(axis=0, initial=0.0)
        )
        good &= bound * HALF <= max(RESOLVED * size, least)
    return good
