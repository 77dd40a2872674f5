"""Sliding on a circle, shaken."""
import numpy as np

from nsbench import Case, Filippov


def drift(xp):
    def f(t, x, s):
        return xp.array(
            [0.9 * x[1] - 0.5 * s[0] * x[0] + 0.8 * xp.cos(t) * x[0], -0.9 * x[0] - 0.5 * s[0] * x[1] + 0.8 * xp.cos(t) * x[1]]
        )
    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0] ** 2 + x[1] ** 2 - 1.0])
    return f


CASE = Case(name="circle_slide", problem=Filippov.signs(drift, switch), x0=np.array([0.5, 0.1]), t=np.linspace(0.0, 15.0, 61))
