"""A start that is not feasible hid that the links cannot reach both anchors at the end: it is
violated more."""

import numpy as np

from nsbench import Case, Complementarity, Distance


def anchor(xp):
    def f(t):
        return xp.array([[1.727 - 0.688 * xp.sin(2.577 * (t + 1.0)), 0.29, -0.578]])

    return f


def second(xp):
    def f(t):
        return xp.array([[0.9 - xp.sin(2.0 * (t + 1.0)), 0.752, 0.301]])

    return f


def drift(xp):
    def f(t, x):
        return xp.array(
            [
                0.2 * x[3] - 0.5,
                0.1 * (t + 1.0),
                -t + xp.tanh(x[7]),
                1.7 * xp.sin(2.5 * x[7]) - 0.1 * x[0],
                -0.6 - 0.4 * x[0],
                -0.6 * x[0] * x[2],
                -1.4 * (t + 1.0),
                -0.7 * xp.sin(2.7 * x[2]) - 0.9,
                -1.7 * xp.sin(0.5 * t + 2.7),
            ]
        )

    return f


CASE = Case(
    name="scene",
    problem=Complementarity(
        drift,
        (
            Distance(d=np.array([2.0, 0.9]), sign=-1, pairs=[[0, 1], [1, 2]], dim=3),
            Distance(d=np.array([2.0, 0.9]), sign=1, pairs=[[0, 1], [1, 2]], dim=3),
            Distance(d=0.71, sign=-1, pairs=[[2, 0]], anchors=anchor, dim=3),
            Distance(d=0.94, sign=-1, pairs=[[2, 0]], anchors=second, dim=3),
        ),
    ),
    x0=np.array([0.0, 0.436, 0.0, 0.7, -0.28, 0.0, 1.4, 0.293, 0.0]),
    t=np.linspace(-1.0, 0.0, 2),
    start="keep",
)

BY = ("pbd", "pbd[order=reverse]", "pbd[sweeps=3]")
