"""Lotka-Volterra with harvest above a threshold."""
import numpy as np

from nsbench import Case, Filippov


def fm(xp):
    def f(t, x):
        return xp.array([x[0] * (1.0 - x[1]), x[1] * (x[0] - 1.0)])
    return f


def fp(xp):
    def f(t, x):
        return xp.array([x[0] * (1.0 - x[1]), x[1] * (x[0] - 1.8)])
    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[1] - 1.2])
    return f


CASE = Case(
    name="lotka_refuge", problem=Filippov({(1,): fp, (-1,): fm}, switch), x0=np.array([0.5, 0.8]), t=np.linspace(0.0, 25.0, 101)
)
