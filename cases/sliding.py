"""Sliding: two constant fields that push a point onto a line and along it.

    x' = (1, -1) for x2 > 0,   x' = (2, 1) for x2 < 0,   x(0) = (0, 1/2)

On the line x2 = 0 the weight of the upper field is 1/2 and the point slides with velocity (3/2, 0).
Explicit Euler chatters about the line with an amplitude of the order of its step: its weight never converges
pointwise, its mean does. No order can be measured here: the fields are constant, and every combination
x1 - x2/2 of the two is the same, so methods that land on the line are exact at grid times.
Exact: x = (t, 1/2 - t) up to t = 1/2, then x = (3t/2 - 1/4, 0).
"""
import numpy as np

from nsbench import Case, Filippov


def above(xp):
    def f(t, x):
        return xp.array([1.0, -1.0]) + 0.0 * x
    return f


def below(xp):
    def f(t, x):
        return xp.array([2.0, 1.0]) + 0.0 * x
    return f


def height(xp):
    def c(t, x):
        return x[1:2]
    return c


def exact(t):
    return np.stack([np.where(t < 0.5, t, 1.5 * t - 0.25), np.maximum(0.5 - t, 0.0)], 1)


def exact_impulse(t):
    return np.where(t < 0.5, t, 0.25 + 0.5 * t)[:, None]


CASE = Case(
    name="sliding",
    problem=Filippov({(+1,): above, (-1,): below}, height),
    x0=np.array([0.0, 0.5]),
    t=np.linspace(0.0, 2.0, 41),
    exact=exact, exact_impulse=exact_impulse, exact_events=(0.5,),
    tags=("exact_at_grid",),
)
