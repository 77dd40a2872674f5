"""The same field on both sides."""
import numpy as np

from nsbench import Case, Filippov


def fp(xp):
    def f(t, x):
        return xp.array([-xp.sin(2.0 * t) - 0.1 * x[0]])
    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0] - 0.4])
    return f


CASE = Case(name="same_field", problem=Filippov({(1,): fp, (-1,): fp}, switch), x0=np.array([1.0]), t=np.linspace(0.0, 12.0, 49))
