"""A slide that ends while the other field leads back at 1e-8: explicit steps and layers stayed
beside the surface."""

import numpy as np

from nsbench import Case, Filippov


def mode_p(xp):
    def f(t, x):
        return xp.array(
            [
                -0.458 * xp.sin(3.639 * x[0]) - 0.478 * x[0] * x[0] * x[0] + 0.1026 * x[0] * x[0],
                -0.559 * x[0] * x[0] * x[0],
                0.4233 * x[2] * x[2],
            ]
        )

    return f


def mode_m(xp):
    def f(t, x):
        return xp.array(
            [
                -0.3189 * x[2] * x[2] - 1.552 * x[1] * x[1] * x[1],
                1.692 * x[0] - 0.494 * x[0] - 1.864 * x[2] * x[2] * x[2],
                -0.5 * xp.sin(0.5 * t + 0.754) + 0.731,
            ]
        )

    return f


def switch(xp):
    def f(t, x):
        return xp.array([xp.sin(9.0 * x[1])])

    return f


CASE = Case(
    name="scene",
    problem=Filippov({(1,): mode_p, (-1,): mode_m}, switch),
    x0=np.array([0.932, 0.712, 0.0]),
    t=np.linspace(0.0, 5.0, 21),
)
BY = ("euler", "penalty")
