"""On a wall with lambda = 0 for ever; beside a wall that moves exactly as the point does."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([1.0, 0.0 * x[1], xp.cos(t)])
    return f


def b(xp):
    def w(t):
        return xp.array([0.0, -xp.sin(t)])
    return w


CASE = Case(
    name="lam_zero",
    problem=Complementarity(drift, (Affine(A=np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), b=b),)),
    x0=np.array([0.0, 0.0, 0.0]),
    t=np.linspace(0.0, 5.0, 26),
)
