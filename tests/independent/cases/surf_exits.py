"""A moving surface too fast to be tracked at times: exits on both sides."""
import numpy as np

from nsbench import Case, Filippov


def drift(xp):
    def f(t, x):
        return xp.array([0.1 * xp.sin(t)])
    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0] - xp.sin(t)])
    return f


CASE = Case(
    name="surf_exits", problem=Filippov.relay(drift, np.array([[-0.8]]), switch), x0=np.array([1.0]), t=np.linspace(0.0, 20.0, 81)
)
