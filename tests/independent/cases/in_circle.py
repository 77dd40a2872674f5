"""Inside a circle, the gradient not normalised."""
import numpy as np

from nsbench import Case, Complementarity, Smooth


def drift(xp):
    def f(t, x):
        return xp.array([1.5 * xp.cos(0.7 * t), 0.8 * xp.sin(1.9 * t) - 0.1 * x[1]])
    return f


def g(xp):
    def f(t, x):
        return xp.array([1.0 - x[0] ** 2 - x[1] ** 2])
    return f


CASE = Case(
    name="in_circle", problem=Complementarity(drift, (Smooth(g),)), x0=np.array([0.1, -0.2]), t=np.linspace(0.0, 15.0, 61)
)
