"""An input that divides Python's zero by zero at one time: no number, as numpy's."""

import numpy as np

from nsbench import LCS, Case


def u(xp):
    def f(t):
        return xp.array([0.0 / t, 2.0 * (t + 1.0), 0.2 * (t + 1.0)])

    return f


def q(xp):
    def f(t):
        return xp.array([1.9 - 0.3 * xp.sin(2.0 * t), 0.7, 1.8 - 0.3 * xp.sin(2.1 * t)])

    return f


CASE = Case(
    name="scene",
    problem=LCS(-np.eye(3), np.eye(3), np.eye(3), np.eye(3), u=u, q=q),
    x0=np.array([0.631, 1.0, 1.0]),
    t=np.linspace(-1.0, 0.0, 11),
)

BY = ("event_driven", "event_driven[compiled=false,max_steps=1500]")
