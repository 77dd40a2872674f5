"""A switch x^3 and a run of 1e-6: what implicit Euler took for rounding of the switch was the whole
motion."""

import numpy as np

from nsbench import Case, Filippov


def drift(xp):
    def f(t, x):
        return xp.array([-1.6])

    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0] * x[0] * x[0]])

    return f


CASE = Case(
    name="scene",
    problem=Filippov.relay(drift, np.array([[-1.0]]), switch),
    x0=np.array([1e-12]),
    t=np.linspace(0.0, 1e-6, 6),
)

BY = ("euler[implicit=true]", "euler", "event_driven", "nosnoc")
