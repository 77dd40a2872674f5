"""Obstacle: a point is blown against a round pillar, slides half way round it and leaves it tangentially.

    x' = (1, 0) + lam grad g,   g = |x| - 1 >= 0,   x(0) = (-2, b),   0 < b < 1

Exact: the point flies straight, x = (t - 2, b), until it meets the pillar at t1 = 2 - sqrt(1 - b^2), at the angle p1
with sin p1 = b. There p' = -sin p and lam = -cos p, so u = tan(p/2) decays like e^-t from u1 = (1 + sqrt(1 - b^2)) / b
and the impulse is ln(sin p / b). At u = 1, the top of the pillar, lam = 0: the point leaves at t2 = t1 + ln u1, with
the impulse -ln b altogether, and flies on, x = (t - t2, 1).

What it is for: the feasible set is not convex (it is prox-regular), and the release has to be found where the force
becomes tangential. The more central the impact, the longer the point stays (dt2/db = -1/b to leading order) and the
more an error in its height matters; b = 0, the blow against the middle, would have two solutions.
"""
import numpy as np

from nsbench import Case, Complementarity, Distance

SUITES = {"standard": [{}], "full": [{"b": 0.01}]}
EAST = np.array([1.0, 0.0])


def drift(xp):
    def f(t, x):
        return EAST + 0.0 * x
    return f


def make(b: float = 0.2) -> Case:
    """b: height of the impact over the middle of the pillar, in (0, 1)."""
    if not 0.0 < b < 1.0:
        raise ValueError(f"b is {b!r}; a number in (0, 1)")
    run = np.sqrt((1.0 - b) * (1.0 + b))
    u1 = (1.0 + run) / b
    t1 = 2.0 - run
    t2 = t1 + np.log(u1)

    def half_angle(t):
        """u = tan(p/2) on the pillar, for t in [t1, t2]."""
        return u1 * np.exp(t1 - np.clip(t, t1, t2))

    def exact(t):
        u = half_angle(t)
        x = np.where(t < t1, t - 2.0, (1.0 - u) * (1.0 + u) / (1.0 + u * u) + np.maximum(t - t2, 0.0))
        return np.stack((x, np.where(t < t1, b, 2.0 * u / (1.0 + u * u))), axis=1)

    def exact_impulse(t):
        u = half_angle(t)
        return np.where(t < t1, 0.0, np.log(2.0 * u / (1.0 + u * u) / b))[:, None]

    T = np.ceil(t2 + 0.7)
    return Case(
        name="obstacle",
        problem=Complementarity(drift, (Distance(d=1.0, sign=+1, pairs=[[0, 0]], anchors=np.zeros((1, 2))),)),
        x0=np.array([-2.0, b]),
        t=np.linspace(0.0, T, 41),
        exact=exact, exact_impulse=exact_impulse, exact_events=(t1, t2), contacts=((0, 0, 0),), substeps=8,
    )
