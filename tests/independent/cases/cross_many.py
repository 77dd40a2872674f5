"""A wheel over two springs: many crossings."""
import numpy as np

from nsbench import Case, Filippov


def fp(xp):
    def f(t, x):
        return xp.array([x[1], -x[0] - 0.3])
    return f


def fm(xp):
    def f(t, x):
        return xp.array([x[1], -1.7 * x[0] + 0.3])
    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0] + 0.2])
    return f


CASE = Case(
    name="cross_many", problem=Filippov({(1,): fp, (-1,): fm}, switch), x0=np.array([1.0, 0.0]), t=np.linspace(0.0, 40.0, 81)
)
