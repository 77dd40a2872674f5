"""Fixed steps went over a pole of the drift between two samples and said ok."""

import numpy as np

from nsbench import Case, Complementarity, Distance


def drift(xp):
    def f(t, x):
        jump = xp.where(t < 1.748, 0.611, -0.111)
        return xp.array(
            [-0.11 * t - x[0], jump - x[1], xp.exp(5.256 * x[0]) - x[2], -1.54 / (t - 1.924) - x[3]]
        )

    return f


CASE = Case(
    name="scene",
    problem=Complementarity(drift, (Distance(d=1.0, dim=2),)),
    x0=np.array([0.0, -0.5000000005, 0.0, 0.5000000005]),
    t=np.linspace(0.0, 5.0, 2),
)

BY = ("pbd", "kdtree")
