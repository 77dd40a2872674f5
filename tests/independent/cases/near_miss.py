"""y = (t - 1)^2 + 1e-9 just misses the floor."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([2.0 * (t - 1.0)])
    return f


CASE = Case(
    name="near_miss",
    problem=Complementarity(drift, (Affine(A=np.eye(1), b=np.zeros(1)),)),
    x0=np.array([1.000000001]),
    t=np.linspace(0.0, 3.0, 32),
)
