"""A state that slides on a surface whose switch is flat, between the only two samples: a penalty
did not see it, and said ok."""

import numpy as np

from nsbench import Case, Filippov


def drift(xp):
    def f(t, x):
        return xp.array(
            [
                -0.034 * xp.sin(0.5 * (t - 100.0) + 0.0)
                + -1.608 * x[2] / (1.0 + x[0] * x[0])
                + 0.795 * x[2],
                -1.532 * xp.sin(3.261 * x[2]) + 0.4596 * x[2] * x[1] + -1.0 * xp.sin(2.0 * x[0]),
                1.359 * (t - 100.0),
            ]
        )

    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0] * x[0] + x[1] * x[1] - 0.5, x[1] * x[1] * x[1]])

    return f


CASE = Case(
    name="scene",
    problem=Filippov.relay(drift, np.array([[0.0, 0.0], [-1.772, -1.728], [-1.936, 0.0]]), switch),
    x0=np.array([1e-12, 0.3, 0.0]),
    t=np.linspace(100.0, 101.0, 2),
)

BY = ("penalty", "penalty[method=kvaerno5]")
