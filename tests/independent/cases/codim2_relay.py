"""Sliding of codimension two with a coupled relay."""
import numpy as np

from nsbench import Case, Filippov


def drift(xp):
    def f(t, x):
        return xp.array([0.4 * xp.cos(t), 0.3 * xp.sin(2.0 * t)])
    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0], x[1]])
    return f


CASE = Case(
    name="codim2_relay",
    problem=Filippov.relay(drift, np.array([[-1.0, -0.5], [0.5, -1.0]]), switch),
    x0=np.array([0.8, 0.9]),
    t=np.linspace(0.0, 8.0, 41),
)
