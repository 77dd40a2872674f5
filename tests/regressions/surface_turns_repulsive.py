"""A surface on which the state slides is left by both fields from t = -0.146 on: event_driven
stayed, and said ok."""

import numpy as np

from nsbench import Case, Filippov


def field(xp):
    def f(t, x, s):
        slope = 0.01 * xp.sin(3.891 * x[1]) + 1.171 * (t + 1.0) - 1.9 * xp.tanh(x[0]) - 1.0
        return xp.array(
            [-1.74 * x[0] + slope * s[0], 1.88 * xp.sin(0.594 * (t + 1.0) + 0.5) - 0.019 * s[0]]
        )

    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0]])

    return f


CASE = Case(
    name="scene",
    problem=Filippov.signs(field, switch),
    x0=np.array([1e-12, -0.2]),
    t=np.linspace(-1.0, 0.0, 2),
)

BY = ("event_driven", "euler", "penalty")
