"""Steps held against their equation, where no proof took them whole: point by point, and on the
whole.

The estimate of a step compares two formulas that a kink or a jump inside it can make wrong by the
same: then it is small by chance. What the path of the step lacks, the integral of f(t, u) - u', is
its error to first order whatever is inside, as the dense outputs of explicit methods are one order
below the step (Hairer, Norsett & Wanner 1993, section II.6), and the difference counts once more
times the step.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nsbench.solvers.event_driven.smooth.pieces import DEGREE, TO_CHEBYSHEV, Piece

UNSEEN = {
    "dop853": 1e5,
    "rk45": 1e6,
    "radau": 1e8,
    "lsoda": 1e8,
}  # local errors by which a step may miss the
#                         equation: dense outputs are of lower order, those of implicit methods of
# much lower
ALONE = 10.0  # local errors that a piece may add to its share of that
EXPLICIT = ("dop853", "rk45")
_EVEN = np.arange(0, DEGREE + 1, 2)
WEIGHTS = (1.0 / (1.0 - _EVEN**2.0)) @ TO_CHEBYSHEV[
    _EVEN
]  # of Clenshaw and Curtis, for a piece of length 1


def shorter(
    fun: Callable, pieces: list[Piece], method: str, atol, rtol: float, share: float
) -> float | None:
    """A length that this step should not exceed, or None: it satisfies y' = fun(t, y) as far as
    `method` can.

    pieces: of the whole step, in order. atol (n,) or scalar, rtol: of one step, `share` of those of
    the run.
    """
    a = pieces[0].lo
    b = pieces[-1].hi
    clock = 64 * np.spacing(max(abs(a), abs(b)))
    missed = pieces[0].y[0] - pieces[-1].y[-1]
    most = 0.0
    for p in pieces:
        slopes = p.slopes()
        part = p.hi - p.lo
        # the nodes are rounded too
        one = atol + rtol * np.abs(p.y).max(axis=0)
        noise = clock * np.abs(slopes).max(axis=0)
        size = (UNSEEN[method] * part / (b - a) + ALONE) * one + noise
        for t, y, slope, weight in zip(p.times, p.y, slopes, part * WEIGHTS, strict=True):
            f = fun(t, y)
            if not np.all(np.abs(slope - f) * part <= size):
                return min(max(p.lo - a, part), 0.5 * (b - a))
            missed = missed + weight * f
        most = np.fmax(most, one / share + noise)
    if method in EXPLICIT and not np.all(np.abs(missed) <= most):
        kink = next((p for p in pieces if not p.proven), pieces[0])
        return min(max(kink.lo - a, kink.hi - kink.lo), (0.5 if kink.lo == a else 0.9) * (b - a))
    return None
