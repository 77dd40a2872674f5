"""Two discs in a round box: Distance and Smooth together."""
import numpy as np

from nsbench import Case, Complementarity, Distance, Smooth


def drift(xp):
    def f(t, x):
        return xp.array([1.2 * xp.cos(t), -0.8 + 0.2 * x[0], 0.9 * xp.cos(1.4 * t), -0.7 - 0.1 * x[3]])
    return f


def g(xp):
    def f(t, x):
        return xp.array([1.0 - xp.sqrt(x[0] ** 2 + x[1] ** 2), 0.9 - xp.sqrt(x[2] ** 2 + x[3] ** 2)])
    return f


CASE = Case(
    name="discs_in_circle",
    problem=Complementarity(
        drift,
        (
            Smooth(g),
            Distance(d=0.5, dim=2),
        ),
    ),
    x0=np.array([-0.3, 0.2, 0.4, 0.1]),
    t=np.linspace(0.0, 9.0, 46),
)
