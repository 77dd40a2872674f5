"""Spiral: infinitely many switches in a finite time, into a point where two surfaces meet.

    x' = B s,   s_i in Sgn(x_i),   B = [[-a, -w], [w, -a]],   x(0) = (1, 0.3),   0 < a < w

Off the axes |x1| + |x2| falls at the constant rate 2 a, so that the origin is reached at (|x1(0)| + |x2(0)|) / (2 a);
each turn shrinks the spiral by ((w - a) / (w + a))^4, so that it makes infinitely many: a Zeno point. A method that
follows events cannot pass it. There s = 0 is the only way on, and the state rests.
Exact: straight lines from axis to axis, summed up; then 0, with weights 1/2.

Implicit Euler shrinks too much at every switch, by O(h): the radius follows r' = -a - C h / r, whose error is
e log(1 + 1/e) in units of r0, with e = C h / (a r0), and C h / a = h / a here. So the order is one, with a logarithm,
for h far below a, and nothing for h far above. In between, around h = a / 5, it is one half over six octaves: that is
where the weak contraction a = 0.1 puts the steps that are worth taking.
"""
import numpy as np

from nsbench import Case, Filippov

SUITES = {"hard": [{}], "full": [{"a": 0.5}]}
X0 = (1.0, 0.3)
SMALL = 1e-30          # what is left of the spiral when the sum is cut off
LISTED = 1e-9          # switches closer than this to the Zeno point are not listed: their times are all but the same


def still(xp):
    def f(t, x):
        return 0.0 * x
    return f


def states(xp):
    def c(t, x):
        return x + 0.0
    return c


def corners(a, w, x0):
    """Times, states (m, 2) and integrals of theta (m, 2) at the switches; the signs (m - 1, 2) in between."""
    B = np.array([[-a, -w], [w, -a]])
    x, s = np.array(x0, float), np.where(np.array(x0) >= 0.0, 1.0, -1.0)
    t, X, S = [0.0], [x], []
    while np.abs(x).max() > SMALL:
        v = B @ s
        i = int(np.argmax(v * s < 0.0))                # one coordinate goes to zero, the other grows
        step = abs(x[i] / v[i])
        x, S = x + step * v, [*S, s.copy()]
        x[i], s[i] = 0.0, -s[i]
        t, X = [*t, t[-1] + step], [*X, x]
    t, S = np.array(t), np.array(S)
    W = np.concatenate((np.zeros((1, 2)), np.cumsum(np.diff(t)[:, None] * (S > 0), axis=0)))
    return t, np.array(X), W, S


def make(a: float = 0.1, w: float = 1.0) -> Case:
    """a: how fast the spiral contracts; w: how fast it turns, more than a."""
    if not 0.0 < a < w:
        raise ValueError(f"a is {a}, w is {w}; 0 < a < w makes a spiral")
    t0, X, W, S = corners(a, w, X0)
    end = sum(X0) / (2.0 * a)
    B = np.array([[-a, -w], [w, -a]])

    def pieces(t):
        k = np.clip(np.searchsorted(t0, t, side="right") - 1, 0, len(S) - 1)
        return k, (t - t0[k])[:, None], (t >= min(end, t0[-1]))[:, None]

    def exact(t):
        k, u, gone = pieces(t)
        return np.where(gone, 0.0, X[k] + u * (S[k] @ B.T))

    def exact_impulse(t):
        k, u, gone = pieces(t)
        return np.where(gone, W[-1] + 0.5 * (t[:, None] - end), W[k] + u * (S[k] > 0))

    return Case(
        name="spiral",
        problem=Filippov.relay(still, B, states),
        x0=np.array(X0),
        t=np.linspace(0.0, 1.25 * end, 41),
        exact=exact, exact_impulse=exact_impulse, exact_events=(*t0[1:][t0[1:] < end - LISTED], end),
        tags=("zeno", "weak") if a <= 0.1 * w else ("zeno",),
    )
