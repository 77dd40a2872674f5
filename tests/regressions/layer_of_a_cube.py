"""A switch x^3: the layer of a penalty is as wide as the cube root of 1 / k, and so is its
error."""

import numpy as np

from nsbench import Case, Filippov


def drift(xp):
    def f(t, x):
        return xp.array([-xp.sin(3.765 * t + 2.988) + 1.584 * xp.tanh(x[0])])

    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0] * x[0] * x[0]])

    return f


CASE = Case(
    name="scene",
    problem=Filippov.relay(drift, np.array([[-1.0]]), switch),
    x0=np.array([0.3]),
    t=np.linspace(0.0, 2.0, 2),
)

BY = ("penalty", "penalty[method=kvaerno5]", "nosnoc", "euler")
