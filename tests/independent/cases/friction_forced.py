"""Forced dry friction oscillator with sticking."""
import numpy as np

from nsbench import Case, Filippov


def drift(xp):
    def f(t, x, s):
        return xp.array([x[1], -x[0] - 0.2 * x[1] + 1.5 * xp.cos(0.7 * t) - 0.6 * s[0]])
    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[1]])
    return f


CASE = Case(name="friction_forced", problem=Filippov.signs(drift, switch), x0=np.array([1.0, 0.5]), t=np.linspace(0.0, 30.0, 121))
