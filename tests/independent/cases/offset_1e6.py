"""A floor at 1e6."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([-xp.cos(t)])
    return f


CASE = Case(
    name="offset_1e6",
    problem=Complementarity(drift, (Affine(A=np.eye(1), b=np.array([-1e6])),)),
    x0=np.array([1e6 + 0.5]),
    t=np.linspace(0.0, 7.0, 36),
)
