"""Contact at t = 1, release at t = 2, dyadic times that are samples."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([0.5 * (t - 2.0)])
    return f


CASE = Case(
    name="release_at_sample",
    problem=Complementarity(drift, (Affine(A=np.eye(1), b=np.zeros(1)),)),
    x0=np.array([0.75]),
    t=np.linspace(0.0, 4.0, 9),
)
