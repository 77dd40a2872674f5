"""Some units are made 1e8 from the origin before a coordinate grows to a million: tolerances were
held against that alone."""

import numpy as np

from nsbench import Case, Filippov


def field(xp):
    def f(t, x, s):
        x = x - 1e8
        return xp.array(
            [
                -0.15 * x[1] + 1.98 * xp.tanh(x[2]) + 0.987 * s[0] - 0.083 * s[0],
                -1.924 * x[1] * x[1] * x[1] + s[0] * (0.5 * x[2]) - 1.0 * s[0],
                -1.0 * x[2] + 0.6 * x[0] * x[2] + 0.5 * s[0] * s[0] - 0.467 * s[0],
            ]
        )

    return f


def switch(xp):
    def f(t, x):
        x = x - 1e8
        return xp.array([x[0]])

    return f


CASE = Case(
    name="scene",
    problem=Filippov.signs(field, switch),
    x0=np.array([100000001.0, 100000000.0, 100000001.0]),
    t=np.linspace(100.0, 105.0, 11),
)
BY = ("penalty", "penalty[method=kvaerno5]", "penalty[extrapolate=1]")
