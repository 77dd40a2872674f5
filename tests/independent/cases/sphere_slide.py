"""Sliding on a sphere, heavy and shaken."""
import numpy as np

from nsbench import Case, Filippov


def drift(xp):
    def f(t, x, s):
        return xp.array(
            [x[1] - s[0] * x[0], -x[0] + 0.3 * x[2] - s[0] * x[1], -0.3 * x[1] - s[0] * x[2] - 0.4 - 1.1 * xp.cos(1.3 * t)]
        )
    return f


def switch(xp):
    def f(t, x):
        return xp.array([xp.sqrt(x[0] ** 2 + x[1] ** 2 + x[2] ** 2) - 1.0])
    return f


CASE = Case(
    name="sphere_slide", problem=Filippov.signs(drift, switch), x0=np.array([0.3, 0.2, 1.5]), t=np.linspace(0.0, 12.0, 49)
)
