"""Repulsive: a line that pushes away on both sides, and a start on it.

    x' = (1, 1) for x2 > 0,   x' = (1, -1) for x2 < 0,   x(0) = (0, height)

From height 0 the solution is not unique: it may stay on the line until any time tau >= 0 (with weight 1/2), or for
ever, and then leave on either side, x = (t, +- max(t - tau, 0)). A reference would be wrong for a method that is
right; what counts is the distance to the set of all solutions, and the inclusion residual. At any other height the
line is never met and the solution is unique: x = (t, height +- t).
"""
import numpy as np

from nsbench import Case, Filippov

SUITES = {"hard": [{}], "full": [{"height": 0.1}]}


def above(xp):
    def f(t, x):
        return xp.array([1.0, 1.0]) + 0.0 * x
    return f


def below(xp):
    def f(t, x):
        return xp.array([1.0, -1.0]) + 0.0 * x
    return f


def line(xp):
    def c(t, x):
        return x[1:2]
    return c


def distance(t, x):
    """Least over side and tau of the largest difference: for a radius r, those tau that come close enough at every
    sample are an interval, so that r is found by bisection."""
    along = float(np.abs(x[:, 0] - t).max())
    return max(along, min(_from(t, x[:, 1]), _from(t, -x[:, 1])))


def _from(t, y):
    """Distance of y to { max(t - tau, 0) }."""
    def close(r):
        # |y - m| <= r with m = max(t - tau, 0): tau >= t - y - r, and tau <= t - y + r wherever y > r
        first, last = max(0.0, (t - y - r).max()), (t - y + r)[y > r].min(initial=np.inf)
        return y.min() >= -r and first <= last

    lo, hi = 0.0, float(np.abs(y).max())
    if close(lo):
        return 0.0
    while hi - lo > 4.0 * np.spacing(hi):
        mid = 0.5 * (lo + hi)
        lo, hi = (lo, mid) if close(mid) else (mid, hi)
    return hi


def make(height: float = 0.0) -> Case:
    """height: of the start above the line; 0 is the one that is not unique."""
    up = np.sign(height)

    def exact(t):
        return np.stack([t, height + up * t], 1)

    def exact_impulse(t):
        return np.where(up > 0, t, 0.0)[:, None]

    known = {"unique": False, "distance": distance} if height == 0.0 else {
        "exact": exact, "exact_impulse": exact_impulse, "exact_events": ()}
    return Case(
        name="repulsive",
        problem=Filippov({(+1,): above, (-1,): below}, line),
        x0=np.array([0.0, height]),
        t=np.linspace(0.0, 2.0, 41),
        **known,
    )
