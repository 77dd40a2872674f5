"""A wedge of 35 degrees, turning force."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([xp.cos(0.9 * t + 2.5), xp.sin(0.9 * t + 2.5)])
    return f


CASE = Case(
    name="corner_acute",
    problem=Complementarity(drift, (Affine(A=np.array([[0.0, 1.0], [np.sin(0.6), -np.cos(0.6)]]), b=np.zeros(2)),)),
    x0=np.array([1.0, 0.3]),
    t=np.linspace(0.0, 16.0, 65),
)
