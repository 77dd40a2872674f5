"""A square box with a nonlinear turning force."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([1.5 * xp.cos(1.3 * t) - 0.3 * x[1], 1.5 * xp.sin(1.3 * t) + 0.3 * x[0] * x[1]])
    return f


CASE = Case(
    name="box_rot",
    problem=Complementarity(drift, (Affine(A=np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]), b=np.full(4, 0.7)),)),
    x0=np.array([0.1, 0.0]),
    t=np.linspace(0.0, 12.0, 49),
)
