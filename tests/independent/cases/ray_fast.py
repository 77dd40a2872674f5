"""Sliding with a field of size 200 and an exit."""
import numpy as np

from nsbench import Case, Filippov


def drift(xp):
    def f(t, x):
        return xp.array([1.0, 150.0 * xp.sin(t) + 30.0 * x[0]])
    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[1] - 0.1 * x[0]])
    return f


CASE = Case(
    name="ray_fast",
    problem=Filippov.relay(drift, np.array([[0.0], [-200.0]]), switch),
    x0=np.array([0.0, 1.0]),
    t=np.linspace(0.0, 3.0, 31),
)
