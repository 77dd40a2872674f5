"""Four walls of a pyramid through one point in 3-D."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([0.2 * xp.cos(t), 0.15 * xp.sin(t), -1.5 + 0.12 * t])
    return f


CASE = Case(
    name="four_walls",
    problem=Complementarity(
        drift, (Affine(A=np.array([[-0.5, 0.0, 1.0], [0.5, 0.0, 1.0], [0.0, -0.5, 1.0], [0.0, 0.5, 1.0]]), b=np.zeros(4)),)
    ),
    x0=np.array([0.3, -0.2, 1.0]),
    t=np.linspace(0.0, 12.0, 49),
)
