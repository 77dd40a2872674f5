"""Walls that contradict each other by 1e-7 of the state were met half-way, unheard."""

import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([-0.919 + 1.508 * t])

    return f


CASE = Case(
    name="scene",
    problem=Complementarity(
        drift, (Affine(np.array([[-1e6], [1e6]]), np.array([-577999.999999999, 577999.8])),)
    ),
    x0=np.array([-0.578]),
    t=np.linspace(0.0, 5.0, 2),
    start="keep",
)

BY = ("pbd", "kdtree")
