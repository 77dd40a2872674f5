"""A moving surface tracked by sliding."""
import numpy as np

from nsbench import Case, Filippov


def fp(xp):
    def f(t, x):
        return xp.array([-1.5])
    return f


def fm(xp):
    def f(t, x):
        return xp.array([1.5])
    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0] - xp.sin(t)])
    return f


CASE = Case(name="surf_moving", problem=Filippov({(1,): fp, (-1,): fm}, switch), x0=np.array([1.0]), t=np.linspace(0.0, 10.0, 41))
