"""Fast forcing 20 cos 50 t - 1."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([20.0 * xp.cos(50.0 * t) - 1.0])
    return f


CASE = Case(
    name="tide_fast50",
    problem=Complementarity(drift, (Affine(A=np.eye(1), b=np.zeros(1)),)),
    x0=np.array([0.3]),
    t=np.linspace(0.0, 2.0, 41),
)
