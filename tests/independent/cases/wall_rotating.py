"""A rotating wall."""
import numpy as np

from nsbench import Case, Complementarity, Smooth


def drift(xp):
    def f(t, x):
        return xp.array([0.3, -1.0])
    return f


def g(xp):
    def f(t, x):
        return xp.array([xp.cos(t) * x[0] + xp.sin(t) * x[1] + 0.5])
    return f


CASE = Case(
    name="wall_rotating", problem=Complementarity(drift, (Smooth(g),)), x0=np.array([1.0, 0.0]), t=np.linspace(0.0, 9.0, 46)
)
