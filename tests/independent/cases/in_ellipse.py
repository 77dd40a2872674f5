"""Inside an ellipse."""
import numpy as np

from nsbench import Case, Complementarity, Smooth


def drift(xp):
    def f(t, x):
        return xp.array([xp.cos(t) + 0.1 * x[1], -xp.sin(0.6 * t) - 0.2])
    return f


def g(xp):
    def f(t, x):
        return xp.array([1.0 - x[0] ** 2 / 4.0 - x[1] ** 2])
    return f


CASE = Case(
    name="in_ellipse", problem=Complementarity(drift, (Smooth(g),)), x0=np.array([-0.5, 0.3]), t=np.linspace(0.0, 15.0, 61)
)
