"""Tolerances of implicit Euler were absolute: a motion by 1e-14 of a state of 1e-8 stayed on its
surface."""

import numpy as np

from nsbench import Case, Filippov


def drift(xp):
    def f(t, x):
        x = x / 1e-08
        return 1e-08 * xp.array([0.0 * x[0], 0.274 * xp.sin(2.427 * x[0]) - 0.1, 0.0 * x[2]])

    return f


def switch(xp):
    def f(t, x):
        x = x / 1e-08
        return xp.array([x[1] * x[1] * x[1], t - 0.518, x[0] - 0.496])

    return f


B = np.array([[0.0, 1.14e-09, 1.127e-08], [1.227e-08, 1e-08, 7.19e-09], [0.0, 1.191e-08, 0.0]])
CASE = Case(
    name="scene",
    problem=Filippov.relay(drift, B, switch),
    x0=np.array([-2e-09, 0.0, 9.72e-09]),
    t=np.linspace(0.0, 1e-06, 21),
)

BY = ("euler", "euler[implicit=true]")
