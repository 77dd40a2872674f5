"""Outside a moving ellipse."""
import numpy as np

from nsbench import Case, Complementarity, Smooth


def drift(xp):
    def f(t, x):
        return xp.array([0.5 + 0.2 * xp.sin(t), -0.3 * x[1]])
    return f


def g(xp):
    def f(t, x):
        return xp.array([(x[0] - 0.3 * xp.sin(2.0 * t)) ** 2 / 2.0 + (x[1] - 0.2 * xp.cos(t)) ** 2 - 1.0])
    return f


CASE = Case(
    name="ellipse_moving", problem=Complementarity(drift, (Smooth(g),)), x0=np.array([-2.5, 0.1]), t=np.linspace(0.0, 10.0, 51)
)
