"""A wall at -cos t hits a point at rest."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([0.0 * x[0]])
    return f


def b(xp):
    def w(t):
        return xp.array([xp.cos(t)])
    return w


CASE = Case(
    name="wall_rest", problem=Complementarity(drift, (Affine(A=np.eye(1), b=b),)), x0=np.array([0.5]), t=np.linspace(0.0, 8.0, 41)
)
