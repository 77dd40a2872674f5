"""Fields of 5e7 that keep a state at rest: the distance to their hull was known to 1e-12 of them, a
velocity of 1e-4."""

import numpy as np

from nsbench import Case, Filippov


def drift(xp):
    def f(t, x):
        x = (x - 0.0) / 100000000.0
        return 100000000.0 * xp.array([-1.98 * xp.sin(1.737 * x[0]) - 1.0 * x[0] * x[0] * x[0]])

    return f


def switch(xp):
    def f(t, x):
        x = (x - 0.0) / 100000000.0
        return xp.array([x[0], xp.sin(9.0 * x[0])])

    return f


CASE = Case(
    name="scene",
    problem=Filippov.relay(drift, np.array([[-50000000.0, 0.0]]), switch),
    x0=np.array([9.999999999999999e-05]),
    t=np.linspace(0.0, 1.0, 21),
)
BY = ("event_driven",)
