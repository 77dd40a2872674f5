"""A switch x^3, and a sample where the state is 1e-13 from its surface: the surface was met 4e-6
late, and said ok."""

import numpy as np

from nsbench import Case, Filippov


def field(xp):
    def f(t, x, s):
        return xp.array(
            [
                -1.732 * x[0] + 0.5 * s[2] * s[0] - 0.355 * s[1],
                xp.sin(1.75 * (t + 1.0) + 2.417) - 1.127 + 0.815 * s[0] - 0.84 * s[1],
                0.5 * s[1] * s[0] - 0.542 * s[2],
            ]
        )

    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0] * x[0] * x[0], x[1], x[1] + 0.5 * x[2]])

    return f


CASE = Case(
    name="scene",
    problem=Filippov.signs(field, switch),
    x0=np.array([0.345, -0.2, -0.2]),
    t=np.array([-1.0, -0.38511825378890396, -0.3]),
)

BY = ("event_driven", "event_driven[compiled=false]")
