"""y = (t - 1.05)^2 - 1e-10: a very short contact."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([2.0 * (t - 1.05)])
    return f


CASE = Case(
    name="dip_1e10",
    problem=Complementarity(drift, (Affine(A=np.eye(1), b=np.zeros(1)),)),
    x0=np.array([1.05 * 1.05 - 1e-10]),
    t=np.linspace(0.0, 3.0, 31),
)
