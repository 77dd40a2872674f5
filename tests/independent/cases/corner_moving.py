"""A wedge of which one wall moves."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([xp.cos(1.1 * t + 2.0), xp.sin(1.1 * t + 2.0)])
    return f


def b(xp):
    def w(t):
        return xp.array([0.0, 0.2 * xp.sin(2.0 * t), 1.1 - 0.1 * t])
    return w


CASE = Case(
    name="corner_moving",
    problem=Complementarity(drift, (Affine(A=np.array([[0.0, 1.0], [np.sin(1.1), -np.cos(1.1)], [-1.0, -1.0]]), b=b),)),
    x0=np.array([0.4, 0.1]),
    t=np.linspace(0.0, 6.0, 31),
)
