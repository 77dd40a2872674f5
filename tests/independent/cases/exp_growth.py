"""Unstable drift held by the floor, then let go."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([x[0] + xp.sin(3.0 * t) - 0.5 * xp.exp(-0.1 * t), -x[1] + 0.01 * x[0]])
    return f


CASE = Case(
    name="exp_growth",
    problem=Complementarity(drift, (Affine(A=np.eye(2), b=np.zeros(2)),)),
    x0=np.array([0.1, 0.3]),
    t=np.linspace(0.0, 7.0, 36),
)
