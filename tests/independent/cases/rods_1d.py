"""Three rods on a line."""
import numpy as np

from nsbench import Case, Complementarity, Distance


def drift(xp):
    def f(t, x):
        return xp.array([-x[0] + 1.2 * xp.sin(t) - 1.0, -x[1] + 0.6 * xp.cos(2.0 * t), -x[2] + 1.3 + 0.9 * xp.sin(1.5 * t)])
    return f


CASE = Case(
    name="rods_1d",
    problem=Complementarity(drift, (Distance(d=0.5, dim=1),)),
    x0=np.array([-1.0, 0.0, 1.0]),
    t=np.linspace(0.0, 12.0, 49),
)
