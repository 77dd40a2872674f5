"""Time-discontinuous forcing."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([xp.where(t < 1.03, -1.0, xp.where(t < 2.17, 0.7, -2.0)) - 0.1 * x[0]])
    return f


CASE = Case(
    name="jump_forcing",
    problem=Complementarity(drift, (Affine(A=np.eye(1), b=np.zeros(1)),)),
    x0=np.array([0.5]),
    t=np.linspace(0.0, 4.0, 41),
)
