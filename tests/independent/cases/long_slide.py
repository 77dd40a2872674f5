"""A slide of length 90 along a wall, then release."""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([1.0 + 0.2 * xp.sin(x[0]), -1.0 + (t / 90.0) ** 2 + 0.1 * xp.cos(x[0]) * (1.0 - t / 90.0)])
    return f


CASE = Case(
    name="long_slide",
    problem=Complementarity(drift, (Affine(A=np.array([[0.1, 1.0]]), b=np.zeros(1)),)),
    x0=np.array([0.0, 0.5]),
    t=np.linspace(0.0, 100.0, 101),
)
