"""Tide with drift: many contact/release cycles."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([xp.cos(t) - 0.2])
    return f


CASE = Case(
    name="tide_many",
    problem=Complementarity(drift, (Affine(A=np.eye(1), b=np.zeros(1)),)),
    x0=np.array([0.5]),
    t=np.linspace(0.0, 70.0, 141),
)
