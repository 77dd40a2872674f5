"""Two points hit 1e-6 apart, one pushes the other."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([-1.0, -1.0 + 0.5 * x[0] + 0.4 * t])
    return f


CASE = Case(
    name="simul_1e6",
    problem=Complementarity(drift, (Affine(A=np.eye(2), b=np.zeros(2)),)),
    x0=np.array([0.7, 0.7 + 1e-6 - 0.5 * 0.245 - 0.2 * 0.49]),
    t=np.linspace(0.0, 4.0, 41),
)
