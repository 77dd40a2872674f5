"""A step had a solution in a stiff field beyond a surface: implicit Euler jumped there."""

import numpy as np

from nsbench import Case, Filippov


def mode_pp(xp):
    def f(t, x):
        return xp.array([-0.3801 * x[0] * x[0]])

    return f


def mode_pm(xp):
    def f(t, x):
        return xp.array([0.246 * t + 0.0 * x[0]])

    return f


def mode_mp(xp):
    def f(t, x):
        return xp.array([-1.876 * xp.sin(1.947 * x[0]) - 0.434 * x[0] * x[0] * x[0]])

    return f


def mode_mm(xp):
    def f(t, x):
        return xp.array([-10000.0 * (x[0] - xp.cos(t))])

    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0] - 0.5 * xp.sin(2.442 * t), 1.5 * x[0]])

    return f


CASE = Case(
    name="scene",
    problem=Filippov(
        {(1, 1): mode_pp, (1, -1): mode_pm, (-1, 1): mode_mp, (-1, -1): mode_mm}, switch
    ),
    x0=np.array([1.0]),
    t=np.linspace(0.0, 5.0, 6),
)

BY = ("euler[implicit=true]", "euler")
