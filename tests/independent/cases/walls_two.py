"""A lower and an upper wall, both moving."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([3.0 * xp.cos(2.0 * t) + 0.5 * xp.sin(5.0 * t)])
    return f


def b(xp):
    def w(t):
        return xp.array([0.5 + 0.3 * xp.sin(t), 0.6 + 0.2 * xp.cos(1.7 * t)])
    return w


CASE = Case(
    name="walls_two",
    problem=Complementarity(drift, (Affine(A=np.array([[1.0], [-2.0]]), b=b),)),
    x0=np.array([0.0]),
    t=np.linspace(0.0, 10.0, 51),
)
