"""A switch of 0.5 and a motion of 1e-8: the rounding of its weight was taken for a missing
complementarity."""

import numpy as np

from nsbench import Case, Filippov


def field(xp):
    def f(t, x, s):
        return xp.array(
            [-1.0 * x[0] + 1.0 * xp.tanh(x[0]) + 1.812 * x[0] - 1.0 * s[0] + 1.0 * s[0]]
        )

    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0] - -0.5])

    return f


CASE = Case(
    name="scene",
    problem=Filippov.signs(field, switch),
    x0=np.array([1e-12]),
    t=np.linspace(100.0, 105.0, 2),
)
BY = ("penalty",)
