"""Stick-slip on a belt with friction that weakens."""
import numpy as np

from nsbench import Case, Filippov


def drift(xp):
    def f(t, x, s):
        return xp.array([x[1], -x[0] - s[0] + 0.2 * (x[1] - 0.5)])
    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[1] - 0.5])
    return f


CASE = Case(name="belt", problem=Filippov.signs(drift, switch), x0=np.array([0.0, 0.0]), t=np.linspace(0.0, 30.0, 61))
