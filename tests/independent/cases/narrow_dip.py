"""Two crossings 2.5e-4 apart."""
import numpy as np

from nsbench import Case, Filippov


def fp(xp):
    def f(t, x):
        return xp.array([1.0])
    return f


def fm(xp):
    def f(t, x):
        return xp.array([4.0])
    return f


def switch(xp):
    def f(t, x):
        return xp.array([(x[0] - 1.0) ** 2 - 2.5e-7])
    return f


CASE = Case(name="narrow_dip", problem=Filippov({(1,): fp, (-1,): fm}, switch), x0=np.array([0.0]), t=np.linspace(0.0, 3.0, 32))
