"""Two walls of a corner hit 1e-9 apart."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([-1.0, -1.0 + 0.3 * t])
    return f


CASE = Case(
    name="simul_1e9",
    problem=Complementarity(drift, (Affine(A=np.array([[1.0, 0.0], [0.6, 0.8]]), b=np.array([0.0, 0.0])),)),
    x0=np.array([0.7, (1.4 * (0.7 + 1e-9) - 0.12 * (0.7 + 1e-9) ** 2 - 0.42) / 0.8]),
    t=np.linspace(0.0, 8.0, 41),
)
