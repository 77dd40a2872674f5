"""A start 1e-12 beside a surface that both fields leave: the layer of a penalty took it to the
other side, and it said ok."""

import numpy as np

from nsbench import Case, Filippov


def field(xp):
    def f(t, x, s):
        return xp.array([0.5 * t + 0.5 + s[0] + 0.0 * x[0]])

    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0] - 0.212 * xp.sin(2.462 * t)])

    return f


CASE = Case(
    name="scene",
    problem=Filippov.signs(field, switch),
    x0=np.array([1e-12]),
    t=np.linspace(0.0, 1.0, 11),
)

BY = ("penalty", "euler")
