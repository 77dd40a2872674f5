"""Two coupled points hit at exactly the same time."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([-xp.cos(t) + 0.0 * x[1], -2.0 * t + 0.5 * t**2, -0.3 + x[0] + x[1]])
    return f


CASE = Case(
    name="simul_exact",
    problem=Complementarity(drift, (Affine(A=np.eye(3), b=np.zeros(3)),)),
    x0=np.array([np.sin(0.5), 0.25 - 0.0625 / 3.0, 0.4]),
    t=np.linspace(0.0, 6.0, 49),
)
