"""On the floor at t = 0, pushed down."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([-xp.cos(t), -1.0 + 0.3 * x[0] + 0.2 * t])
    return f


CASE = Case(
    name="start_out",
    problem=Complementarity(drift, (Affine(A=np.eye(2), b=np.zeros(2)),)),
    x0=np.array([0.0, 0.0]),
    t=np.linspace(0.0, 8.0, 41),
)
