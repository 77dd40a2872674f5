"""Van der Pol between two walls."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([x[1], 2.0 * (1.0 - x[0] ** 2) * x[1] - x[0]])
    return f


CASE = Case(
    name="vdp_clipped",
    problem=Complementarity(drift, (Affine(A=np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), b=np.array([1.5, 1.5, 2.5])),)),
    x0=np.array([0.5, 0.0]),
    t=np.linspace(0.0, 20.0, 81),
)
