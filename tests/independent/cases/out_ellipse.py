"""Wind around an ellipse: release by curvature."""
import numpy as np

from nsbench import Case, Complementarity, Smooth


def drift(xp):
    def f(t, x):
        return xp.array([1.0, -0.1 * x[1]])
    return f


def g(xp):
    def f(t, x):
        return xp.array([x[0] ** 2 / 4.0 + x[1] ** 2 - 1.0])
    return f


CASE = Case(
    name="out_ellipse", problem=Complementarity(drift, (Smooth(g),)), x0=np.array([-4.0, 0.05]), t=np.linspace(0.0, 9.0, 46)
)
