"""A particle squeezed between a link and an anchor on a line came out behind the anchor, and said
ok."""

import numpy as np

from nsbench import Case, Complementarity, Distance


def anchor(xp):
    def f(t):
        return xp.array([[-0.366 + 0.313 * xp.sin(0.56 * (t - 100.0))]])

    return f


def second(xp):
    def f(t):
        return xp.array([[-0.545 + -0.884 * xp.sin(1.281 * (t - 100.0))]])

    return f


def drift(xp):
    def f(t, x):
        return xp.array([-1.0 + 1.471, 2.0 + 1.431 + -0.5556 * x[0] * x[0]])

    return f


CORE = Distance(d=0.001, sign=1, pairs=[[1, 0]], anchors=anchor, dim=1)
LINKS = (
    Distance(d=np.array([0.0010000000001]), sign=-1, pairs=[[0, 1]], dim=1),
    Distance(d=0.546, sign=-1, pairs=[[1, 0]], anchors=second, dim=1),
)
CASE = Case(
    name="scene",
    problem=Complementarity(drift, (LINKS[0], CORE, LINKS[1])),
    x0=np.array([0.0, 0.001]),
    t=np.linspace(100.0, 100.7, 2),
)

BY = ("pbd", "penalty")
