"""At rest on a surface: what complementarity leaves was compared with the way of the run, which was
nothing but that."""

import numpy as np

from nsbench import Case, Filippov


def mode_p(xp):
    def f(t, x):
        x = x / 1e8
        return 1e8 * xp.array([0.607 * xp.tanh(x[0]) + -0.903 * t])

    return f


def mode_m(xp):
    def f(t, x):
        x = x / 1e8
        return 1e8 * xp.array([-0.126 * xp.sin(2.728 * x[0])])

    return f


def switch(xp):
    def f(t, x):
        return x / 1e8

    return f


CASE = Case(
    name="scene",
    problem=Filippov({(1,): mode_p, (-1,): mode_m}, switch),
    x0=np.array([0.0]),
    t=np.linspace(0.0, 1.0, 2),
)

BY = ("nosnoc",)
