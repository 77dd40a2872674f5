"""The surface is touched, not crossed."""
import numpy as np

from nsbench import Case, Filippov


def fp(xp):
    def f(t, x):
        return xp.array([2.0 * (t - 1.0), 1.0])
    return f


def fm(xp):
    def f(t, x):
        return xp.array([1.0, -2.0])
    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0]])
    return f


CASE = Case(
    name="touch_surface", problem=Filippov({(1,): fp, (-1,): fm}, switch), x0=np.array([1.0, 0.0]), t=np.linspace(0.0, 3.0, 31)
)
