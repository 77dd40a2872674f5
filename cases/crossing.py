"""Crossing: a line that is passed without sliding.

    x' = (1, -1) for x2 > 0,   x' = (2, -3) for x2 < 0,   x(0) = (0, sqrt(2)/4)

The smallest case of a jump in the field: a fixed-step method is exact on both sides and wrong by a part of one
step at the line, so its local slopes are erratic and only its envelope has order one.
Exact: with t1 = sqrt(2)/4, x = (t, t1 - t) up to t1, then x = (2 t - t1, 3 (t1 - t)).
"""
import numpy as np

from nsbench import Case, Filippov

SUITES = {"full": [{}]}
T1 = np.sqrt(2.0) / 4


def above(xp):
    def f(t, x):
        return xp.array([1.0, -1.0]) + 0.0 * x
    return f


def below(xp):
    def f(t, x):
        return xp.array([2.0, -3.0]) + 0.0 * x
    return f


def height(xp):
    def c(t, x):
        return x[1:2]
    return c


def exact(t):
    late = np.maximum(t - T1, 0.0)
    return np.stack([t + late, T1 - t - 2.0 * late], 1)


def exact_impulse(t):
    return np.minimum(t, T1)[:, None]


CASE = Case(
    name="crossing",
    problem=Filippov({(+1,): above, (-1,): below}, height),
    x0=np.array([0.0, T1]),
    t=np.linspace(0.0, 1.0, 31),
    exact=exact, exact_impulse=exact_impulse, exact_events=(T1,),
)
