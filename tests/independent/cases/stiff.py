"""Stiff relaxation to cos t above a floor."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([-1e4 * (x[0] - xp.cos(t))])
    return f


CASE = Case(
    name="stiff",
    problem=Complementarity(drift, (Affine(A=np.eye(1), b=np.zeros(1)),)),
    x0=np.array([1.0]),
    t=np.linspace(0.0, 8.0, 41),
)
