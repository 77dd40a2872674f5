"""States of 1e-12: the layer of a penalty was never left, and held for the surface."""

import numpy as np

from nsbench import Case, Filippov


def mode_p(xp):
    def f(t, x):
        return xp.array([-1.483 * x[0] / (1.0 + x[0] * x[0])])

    return f


def mode_m(xp):
    def f(t, x):
        return xp.array(
            [
                -0.547 * xp.abs(x[0])
                + 0.895 * x[0] / (1.0 + x[0] * x[0])
                + -0.867 * x[0] * x[0] * x[0]
            ]
        )

    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0]])

    return f


CASE = Case(
    name="scene",
    problem=Filippov({(1,): mode_p, (-1,): mode_m}, switch),
    x0=np.array([1e-12]),
    t=np.linspace(-1.0, 0.0, 6),
)

BY = ("penalty", "penalty[method=kvaerno5]", "penalty[extrapolate=1]")
