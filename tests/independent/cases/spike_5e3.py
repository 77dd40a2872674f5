"""A spike of width 5e-3 in T = 10 pushes onto the floor."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([0.01 - 34.0 * xp.exp(-(((t - 5.003) / 0.005) ** 2))])
    return f


CASE = Case(
    name="spike_5e3",
    problem=Complementarity(drift, (Affine(A=np.eye(1), b=np.zeros(1)),)),
    x0=np.array([0.1]),
    t=np.linspace(0.0, 10.0, 21),
)
