"""On the floor at t = 0, pushed off."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([xp.cos(t)])
    return f


CASE = Case(
    name="start_in",
    problem=Complementarity(drift, (Affine(A=np.eye(1), b=np.zeros(1)),)),
    x0=np.array([0.0]),
    t=np.linspace(0.0, 8.0, 41),
)
