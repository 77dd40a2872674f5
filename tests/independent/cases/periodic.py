"""Time-periodic fields, sliding and crossing."""
import numpy as np

from nsbench import Case, Filippov


def fp(xp):
    def f(t, x):
        return xp.array([x[1] + 0.2, -1.0 + 1.6 * xp.sin(t) * xp.cos(0.4 * t) - 0.2 * x[0]])
    return f


def fm(xp):
    def f(t, x):
        return xp.array([x[1] - 0.2, 1.0 + 1.6 * xp.sin(t) - 0.2 * x[0]])
    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[1] + 0.1 * x[0]])
    return f


CASE = Case(
    name="periodic", problem=Filippov({(1,): fp, (-1,): fm}, switch), x0=np.array([0.5, 1.0]), t=np.linspace(0.0, 20.0, 81)
)
