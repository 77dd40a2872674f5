"""Two constraints that touch once and open slowly pushed on, by tolerance over gap."""

import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array(
            [0.3 * x[1] * x[1], 0.967 * xp.sin(1.183 * x[0]) - 0.5088 * x[0] * x[1] + 0.6]
        )

    return f


CASE = Case(
    name="scene",
    problem=Complementarity(
        drift, (Affine(np.array([[1.0, 0.0], [0.001, 0.0]]), np.array([-0.305, -0.000305])),)
    ),
    x0=np.array([0.305, -0.077]),
    t=np.linspace(-1.0, 4.0, 11),
)

BY = ("nosnoc",)
