"""Lengths of 1e-6, times of 1e-3."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([-4e-3 * xp.cos(6000.0 * t) - 1e-3, 1e-3 - 200.0 * x[1] + 4e3 * x[0]])
    return f


CASE = Case(
    name="tiny",
    problem=Complementarity(drift, (Affine(A=np.array([[1.0, 0.0], [0.0, -1.0]]), b=np.array([0.0, 2e-6])),)),
    x0=np.array([0.4e-6, 0.5e-6]),
    t=np.linspace(0.0, 1e-3, 41),
)
