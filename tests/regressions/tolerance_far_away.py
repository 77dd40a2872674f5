"""A motion of 14 000 at 1e8 from the origin: the relative tolerance of the integrator was of the
coordinates."""

import numpy as np

from nsbench import Case, Filippov


def field(xp):
    def f(t, x, s):
        x = x - 1e8
        return xp.array([1.856 * x[0] + 1.888 * xp.tanh(x[0]) - 0.38 * s[0]])

    return f


def switch(xp):
    def f(t, x):
        x = x - 1e8
        return xp.array([x[0]])

    return f


CASE = Case(
    name="scene",
    problem=Filippov.signs(field, switch),
    x0=np.array([1e8 + 0.4]),
    t=np.linspace(0.0, 5.0, 11),
)

BY = ("penalty[method=kvaerno5]", "penalty")
