"""A spike of width 5e-3 in a wall-bound oscillator."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([x[1] * 0.3, -0.5 * x[1] - 100.0 * xp.exp(-(((t - 6.2137) / 0.005) ** 2)) + 0.2])
    return f


CASE = Case(
    name="spike_2d",
    problem=Complementarity(drift, (Affine(A=np.array([[0.3, 1.0]]), b=np.array([0.1])),)),
    x0=np.array([0.4, 0.05]),
    t=np.linspace(0.0, 10.0, 11),
)
