"""A jump of the drift inside an interval stayed in the residual of a penalty, whose samples were
not refined."""

import numpy as np

from nsbench import Case, Filippov


def field(xp):
    def f(t, x, s):
        jump = xp.where(t < 100.815, -1.475, 1.975) + xp.where(t < 100.077, -1.68, 2.18)
        return xp.array([jump - 300.0 * (x[0] - xp.cos(t - 100.0)) + 0.269 * s[2]])

    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0], 1000.0 * x[0], 1.5 * x[0]])

    return f


CASE = Case(
    name="scene",
    problem=Filippov.signs(field, switch),
    x0=np.array([1.0]),
    t=np.linspace(100.0, 101.0, 2),
)

BY = ("penalty",)
