"""A field with the square of a sign: between the modes it is 1, as in both, but a layer took it for
less."""

import numpy as np

from nsbench import Case, Filippov


def field(xp):
    def f(t, x, s):
        return xp.array([0.3 * s[0] * s[0] - s[0], s[0] * s[0] - 0.2 * s[0]])

    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0]])

    return f


CASE = Case(
    name="scene",
    problem=Filippov.signs(field, switch),
    x0=np.array([0.3, 0.0]),
    t=np.linspace(0.0, 2.0, 6),
)

BY = ("penalty", "penalty[extrapolate=1]", "euler[implicit=true]", "event_driven")
