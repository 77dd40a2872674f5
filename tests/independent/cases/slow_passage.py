"""Contact and release at a speed of 1e-3."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([-1e-3 - 0.1 * (t - 2.0) ** 2, -1e-3 * xp.cos(0.3 * t)])
    return f


CASE = Case(
    name="slow_passage",
    problem=Complementarity(drift, (Affine(A=np.eye(2), b=np.zeros(2)),)),
    x0=np.array([2e-3 + 0.8 / 3.0, 2.5e-3]),
    t=np.linspace(0.0, 20.0, 41),
)
