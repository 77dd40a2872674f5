"""The tolerance of a penalty was absolute beside a smooth constraint in a unit of 1e-8."""

import numpy as np

from nsbench import Case, Complementarity, Smooth


def g(xp):
    def f(t, x):
        x = x / 1e-08
        return 1e-08 * xp.array(
            [1.0 - x[0] ** 2 - x[1] ** 2, x[1] + 0.7 - 0.2 * xp.sin(3.0 * x[0])]
        )

    return f


def drift(xp):
    def f(t, x):
        x = x / 1e-08
        first = (
            -1.147 * xp.sin(4.381 * (t + 1.0) + 1.0)
            - 0.5 * xp.tanh(x[1])
            + 1.612 * x[0] / (1.0 + x[1] * x[1])
        )
        return 1e-08 * xp.array([first, -0.346 * x[0] * x[0] * x[0] + 1.443 * x[0]])

    return f


CASE = Case(
    name="scene",
    problem=Complementarity(drift, (Smooth(g),)),
    x0=np.array([2.86e-09, 3.92e-09]),
    t=np.linspace(-1.0, -0.3, 2),
    start="project",
)

BY = ("penalty",)
