"""T = 1000."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([xp.cos(0.05 * t) - 0.1 + 0.05 * xp.sin(0.31 * t)])
    return f


CASE = Case(
    name="long_T",
    problem=Complementarity(drift, (Affine(A=np.eye(1), b=np.zeros(1)),)),
    x0=np.array([3.0]),
    t=np.linspace(0.0, 1000.0, 201),
)
