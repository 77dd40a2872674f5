"""A wall with a bump of width 1e-2 hits a point at rest."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([0.0 * x[0]])
    return f


def b(xp):
    def w(t):
        return xp.array([1.0 - 1.2 * xp.exp(-(((t - 3.3) / 0.01) ** 2))])
    return w


CASE = Case(
    name="wall_bump",
    problem=Complementarity(drift, (Affine(A=np.eye(1), b=b),)),
    x0=np.array([0.0]),
    t=np.linspace(0.0, 10.0, 21),
)
