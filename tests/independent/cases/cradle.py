"""A row of three discs in a plane hit one by one."""
import numpy as np

from nsbench import Case, Complementarity, Distance


def drift(xp):
    def f(t, x):
        return xp.array([1.0, 0.0, 0.1 * xp.cos(t), 0.05, -0.6 + 0.4 * t, -0.05 * t])
    return f


CASE = Case(
    name="cradle",
    problem=Complementarity(drift, (Distance(d=0.4, dim=2),)),
    x0=np.array([-1.5, 0.0, 0.0, 0.1, 0.9, 0.05]),
    t=np.linspace(0.0, 6.0, 31),
)
