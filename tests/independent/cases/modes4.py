"""Two surfaces, four modes."""
import numpy as np

from nsbench import Case, Filippov


def pp(xp):
    def f(t, x):
        return xp.array([-1.0 + 0.3 * x[1], -0.7])
    return f


def pm(xp):
    def f(t, x):
        return xp.array([-0.8, 0.9 + 0.2 * xp.sin(t)])
    return f


def mp_(xp):
    def f(t, x):
        return xp.array([0.7 + 0.5 * xp.cos(t), -1.1])
    return f


def mm(xp):
    def f(t, x):
        return xp.array([1.2, 0.6 - 0.1 * x[0]])
    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0] - 0.1 * x[1], x[1] - 0.5 * xp.sin(0.5 * t)])
    return f


CASE = Case(
    name="modes4",
    problem=Filippov({(1, 1): pp, (1, -1): pm, (-1, 1): mp_, (-1, -1): mm}, switch),
    x0=np.array([0.6, 1.0]),
    t=np.linspace(0.0, 10.0, 51),
)
