"""Split a step into pieces on which the data are proven to be smooth, and test the step elsewhere.

The functions of a case (drift, moving walls, smooth constraints) are enclosed along the polynomial
that the integrator gives for the step, with all derivatives up to the ninth (see interval_taylor).
Interpolation at NODES of a piece of radius r is then off by at most  |q^(9)| r^9 / 9! / 2^7  (Davis
1963, theorem 3.1.1, with the Chebyshev extrema as nodes), and nothing narrower than the piece hides
in it. Pieces are halved until that bound is small.

A step with unproven pieces is compared with its equation y' = f(t, y), at points and in the
integral. The error estimate of a step compares two formulas that a kink or a jump inside it can
make wrong by the same amount: then it is small by chance. The defect of the path u of the step, the
integral of f(t, u) - u', is its error to first order whatever is inside, as the dense outputs of
explicit methods are one order below the step (Hairer, Norsett & Wanner 1993, section II.6), and the
difference enters with one more factor of the step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nsbench.dynamics.interval_taylor import ORDER, as_jet, clock, path
from nsbench.solvers.event_driven.smooth.integrators import Integrator

DEGREE = ORDER - 1  # of the interpolants: one more than the dense output of DOP853
# Interpolation error of the data, relative to their size, up to which they count as smooth.
SMOOTH_ERROR = 1e-10
MAX_DEPTH = 19  # halvings: features of 2e-6 of a step are resolved, narrower ones are left open
MAX_UNRESOLVED = 64  # pieces of one size: beyond, proofs cost more than they are worth
# Local errors by which a piece may miss the equation beyond its share of Integrator.defect.
PIECE_DEFECT = 10.0

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
INTERPOLATION_FACTOR = 1.0 / 2.0 ** (DEGREE - 1)  # of Davis's bound
_EVEN = np.arange(0, DEGREE + 1, 2)
# Weights of Clenshaw-Curtis quadrature for a piece of length 1.
WEIGHTS = (1.0 / (1.0 - _EVEN**2.0)) @ TO_CHEBYSHEV[_EVEN]


@dataclass(frozen=True)
class Piece:
    """Interval [lo, hi] of time with the path at its NODES, y (9, n).

    depth: halvings that led to it. proven: nothing narrower than the piece hides in it.
    """

    lo: float
    hi: float
    y: np.ndarray
    depth: int
    proven: bool

    @property
    def times(self) -> np.ndarray:
        """Times of the nodes, (9,)."""
        return nodes(self.lo, self.hi)

    def time_at(self, s: float) -> float:
        """Return the time at s in [-1, 1]."""
        return 0.5 * (self.lo + self.hi) + 0.5 * (self.hi - self.lo) * s

    def slopes(self) -> np.ndarray:
        """Return the derivative of the path at the nodes, (9, n)."""
        return TO_SLOPES @ self.y * (2.0 / (self.hi - self.lo))


def nodes(lo: float, hi: float) -> np.ndarray:
    """Return the Chebyshev extrema of [lo, hi], (9,)."""
    times = 0.5 * (lo + hi) + 0.5 * (hi - lo) * NODES
    times[0] = lo
    times[-1] = hi
    return times


def single_piece(
    dense: Callable, lo: float, hi: float, depth: int = 0, proven: bool = False
) -> Piece:
    """Return [lo, hi] as one piece of the path `dense`."""
    return Piece(lo, hi, dense(nodes(lo, hi)).T, depth, proven)


def split_where_smooth(
    dense: Callable, lo: float, hi: float, data: Callable | None
) -> list[Piece] | None:
    """Split [lo, hi] into pieces, in order, that are proven smooth where that is possible.

    dense: path of the step. data(t, y): functions of the case, called with Jets. Returns None if
    nothing can be proven.
    """
    if data is None:
        return None
    done = []
    open_ = [single_piece(dense, lo, hi)]
    # the data may be lengths, or speeds over the step
    size = (1.0 + np.abs(open_[0].y).max(initial=0.0)) / max(hi - lo, 1.0)
    # Bisection of all pieces that are not yet proven to be smooth.
    for depth in range(MAX_DEPTH + 1):
        smooth = _prove_smooth(open_, data, SMOOTH_ERROR * size)
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
        if depth == MAX_DEPTH or rest[0].hi - rest[0].lo < 64 * np.spacing(max(abs(lo), abs(hi))):
            done += rest
            break
        if len(rest) > MAX_UNRESOLVED:
            return None
        open_ = [
            single_piece(dense, *ends, depth + 1)
            for p in rest
            for ends in ((p.lo, 0.5 * (p.lo + p.hi)), (0.5 * (p.lo + p.hi), p.hi))
        ]
    return sorted(done, key=lambda p: p.lo)


def _prove_smooth(pieces, data, least):
    """Check on each piece that the bound is below SMOOTH_ERROR of the data, or `least`; mask (K,).

    None if the data are written in a way that Jets do not follow.
    """
    ends = np.array([(p.lo, p.hi) for p in pieces])
    c = np.stack([TO_POWERS @ p.y for p in pieces], axis=1)  # (9, K, n)
    try:
        enclosures = [
            as_jet(q, len(pieces))
            for q in data(
                clock(ends.mean(1), 0.5 * (ends[:, 1] - ends[:, 0])),
                path(np.moveaxis(c, 0, -1).transpose(1, 0, 2)),
            )
        ]
    except (TypeError, ValueError, AttributeError, IndexError, NotImplementedError):
        return None  # the run reports it: column `roots` is then "sampled"
    good = np.ones(len(pieces), bool)
    for q in enclosures:
        low = np.abs(q.mid[..., 0]) - q.rad[..., 0]  # proven to be reached
        size = np.nanmax(np.where(np.isfinite(low), low, 0.0), initial=0.0)
        bound = (
            (np.abs(q.mid[..., ORDER]) + q.rad[..., ORDER])
            .reshape(-1, len(pieces))
            .max(axis=0, initial=0.0)
        )
        good &= bound * INTERPOLATION_FACTOR <= max(SMOOTH_ERROR * size, least)
    return good


def shorter_step(
    fun: Callable,
    pieces: list[Piece],
    integrator: Integrator,
    atol: float | np.ndarray,
    rtol: float,
    share: float,
) -> float | None:
    """Return a length that this step should not exceed; None if it satisfies y' = fun(t, y).

    pieces: of the whole step, in order. atol (n,) or scalar, rtol: of one step, `share` of those of
    the run. The defect is compared with what the dense output of the integrator allows at each
    node, and for explicit methods in its integral over the step with the tolerance of the run.
    """
    a = pieces[0].lo
    b = pieces[-1].hi
    time_rounding = 64 * np.spacing(max(abs(a), abs(b)))
    defect = pieces[0].y[0] - pieces[-1].y[-1]
    allowed = 0.0
    for p in pieces:
        slopes = p.slopes()
        length = p.hi - p.lo
        local_error = atol + rtol * np.abs(p.y).max(axis=0)
        noise = time_rounding * np.abs(slopes).max(axis=0)  # the nodes are rounded too
        size = (integrator.defect * length / (b - a) + PIECE_DEFECT) * local_error + noise
        for t, y, slope, weight in zip(p.times, p.y, slopes, length * WEIGHTS, strict=True):
            f = fun(t, y)
            if not np.all(np.abs(slope - f) * length <= size):
                return min(max(p.lo - a, length), 0.5 * (b - a))
            defect = defect + weight * f
        allowed = np.fmax(allowed, local_error / share + noise)
    if integrator.explicit and not np.all(np.abs(defect) <= allowed):
        kink = next((p for p in pieces if not p.proven), pieces[0])
        return min(max(kink.lo - a, kink.hi - kink.lo), (0.5 if kink.lo == a else 0.9) * (b - a))
    return None
