"""A floor at 0.8 sin 2t."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([0.1 - 0.5 * x[0]])
    return f


def b(xp):
    def w(t):
        return xp.array([-0.8 * xp.sin(2.0 * t)])
    return w


CASE = Case(
    name="wall_moving",
    problem=Complementarity(drift, (Affine(A=np.eye(1), b=b),)),
    x0=np.array([0.5]),
    t=np.linspace(0.0, 12.0, 61),
)
