"""Two surfaces hit at exactly the same time."""
import numpy as np

from nsbench import Case, Filippov


def drift(xp):
    def f(t, x):
        return xp.array([1.5 * xp.sin(t), 1.5 * xp.sin(t) + 0.2 * (x[0] - x[1])])
    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0], x[1]])
    return f


CASE = Case(
    name="two_simul", problem=Filippov.relay(drift, -np.eye(2), switch), x0=np.array([1.0, 1.0]), t=np.linspace(0.0, 9.0, 46)
)
