"""The switching function dips below zero for 1e-2 in T = 10."""
import numpy as np

from nsbench import Case, Filippov


def fp(xp):
    def f(t, x):
        return xp.array([1.0])
    return f


def fm(xp):
    def f(t, x):
        return xp.array([-200.0])
    return f


def switch(xp):
    def f(t, x):
        return xp.array([1.0 - 1.2 * xp.exp(-(((t - 3.3) / 0.01) ** 2))])
    return f


CASE = Case(name="switch_bump", problem=Filippov({(1,): fp, (-1,): fm}, switch), x0=np.array([0.0]), t=np.linspace(0.0, 10.0, 21))
