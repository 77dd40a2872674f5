"""A chain of three links pulled by a moving anchor."""
import numpy as np

from nsbench import Case, Complementarity, Distance


def drift(xp):
    def f(t, x):
        return xp.array([-0.5 * x[0], -0.5 * x[1] - 0.2, -0.5 * x[2], -0.5 * x[3] - 0.2, -0.5 * x[4], -0.5 * x[5] - 0.2])
    return f


def anchors(xp):
    def a(t):
        return xp.array([[2.0 * xp.sin(t), xp.cos(0.7 * t)]])
    return a


CASE = Case(
    name="chain_pulled",
    problem=Complementarity(
        drift,
        (
            Distance(d=0.5, sign=-1, dim=2, anchors=anchors, pairs=[[0, 0]]),
            Distance(d=0.5, sign=-1, dim=2, pairs=[[0, 1], [1, 2]]),
        ),
    ),
    x0=np.array([0.1, 0.7, 0.0, 0.5, 0.1, 0.3]),
    t=np.linspace(0.0, 8.0, 41),
)
