"""Friction: a mass on a spring that dry friction stops within a finite time.

    x' = v,   v' = -x - mu s,   s in Sgn(v),   mu = 0.3,   (x, v)(0) = (1, 0)

The swing loses 2 mu of its amplitude in each half turn and sticks at the first turn inside |x| <= mu: at
t = 2 pi in x = -0.2, with s = 2/3. The start itself lies on the surface v = 0.
Exact: x = mu + (1 - mu) cos t, then x = -mu + (1 - 3 mu) cos t from t = pi, then rest from t = 2 pi.
"""
import numpy as np

from nsbench import Case, Filippov

SUITES = {"full": [{}]}
MU = 0.3


def field(xp):
    def f(t, x, s):
        return xp.array([x[1], -x[0] - MU * s[0]])
    return f


def speed(xp):
    def c(t, x):
        return x[1:2]
    return c


def exact(t):
    mid, radius = np.where(t < np.pi, MU, -MU), np.where(t < np.pi, 1 - MU, 1 - 3 * MU)
    u = np.minimum(t, 2 * np.pi)
    return np.stack([mid + radius * np.cos(u), np.where(t < 2 * np.pi, -radius * np.sin(u), 0.0)], 1)


def exact_impulse(t):
    stuck = 0.5 * (1.0 + (4 * MU - 1) / MU)                    # theta = (1 + s) / 2 with s = -x / mu
    return (np.clip(t - np.pi, 0.0, np.pi) + stuck * np.maximum(t - 2 * np.pi, 0.0))[:, None]


CASE = Case(
    name="friction",
    problem=Filippov.signs(field, speed),
    x0=np.array([1.0, 0.0]),
    t=np.linspace(0.0, 8.0, 41),
    exact=exact, exact_impulse=exact_impulse, exact_events=(np.pi, 2 * np.pi),
)
