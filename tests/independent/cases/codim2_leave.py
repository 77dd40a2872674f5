"""Sliding of codimension two and its ends."""
import numpy as np

from nsbench import Case, Filippov


def drift(xp):
    def f(t, x):
        return xp.array([1.3 * xp.cos(t), 1.2 * xp.sin(1.7 * t)])
    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0], x[1] - 0.2 * x[0]])
    return f


CASE = Case(
    name="codim2_leave",
    problem=Filippov.relay(drift, np.array([[-1.0, -0.2], [0.3, -1.0]]), switch),
    x0=np.array([0.3, 0.9]),
    t=np.linspace(0.0, 10.0, 51),
)
