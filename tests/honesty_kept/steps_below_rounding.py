"""A switch 1e8 from the origin, run with millions of steps: their roundings were more than the motion that they made."""
import numpy as np

from nsbench import Case, Filippov


def field(xp):
    def f(t, x, s):
        return xp.array([0.1 * s[0], -0.5 - 0.1 * s[0]])
    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[1] - 1e8])
    return f


CASE = Case(
    name="scene",
    problem=Filippov.signs(field, switch),
    x0=np.array([1e8, 1e8 + 0.2]),
    t=np.linspace(0.0, 1.0, 6),
)

BY = ("euler", "euler[implicit=true]", "event_driven[method=rk45]")
