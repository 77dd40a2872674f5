"""Fixed steps went over a pole of the drift and said ok."""

import numpy as np

from nsbench import Case, Complementarity


def drift(xp):
    def f(t, x):
        x = x / 1e-08
        return 1e-08 * xp.array([2.0 / (t - 0.715), -1.74 * xp.abs(x[1]) + 0.3 * x[1] * x[0] - 1.0])

    return f


CASE = Case(
    name="scene",
    problem=Complementarity(drift),
    x0=np.array([8.9e-09, -2.3e-10]),
    t=np.linspace(-1.0, 1.0, 2),
)

BY = ("euler", "euler[implicit=true]")
