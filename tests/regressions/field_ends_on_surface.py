"""One field ends on the surface: what is left of complementarity keeps nosnoc's state beside it,
sqrt(1e-10) away."""

import numpy as np

from nsbench import Case, Filippov


def mode_p(xp):
    def f(t, x):
        return xp.array([-0.492 * x[0] * x[0]])

    return f


def mode_m(xp):
    def f(t, x):
        return xp.array([-30.0 * (x[0] - xp.cos(t)) - 0.5])

    return f


def switch(xp):
    def f(t, x):
        return xp.array([1.5 * x[0]])

    return f


CASE = Case(
    name="scene",
    problem=Filippov({(1,): mode_p, (-1,): mode_m}, switch),
    x0=np.array([0.0]),
    t=np.linspace(0.0, 1.0, 2),
)

BY = ("nosnoc",)
