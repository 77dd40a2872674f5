"""y = (t - 1)^2 - 1e-6: a short contact."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([2.0 * (t - 1.0)])
    return f


CASE = Case(
    name="dip_1e6",
    problem=Complementarity(drift, (Affine(A=np.eye(1), b=np.zeros(1)),)),
    x0=np.array([0.999999]),
    t=np.linspace(0.0, 3.0, 32),
)
