"""An anchor flies past a point at rest and knocks it aside."""
import numpy as np

from nsbench import Case, Complementarity, Distance


def drift(xp):
    def f(t, x):
        return xp.array([0.0, 0.02])
    return f


def anchors(xp):
    def a(t):
        return xp.array([[20.0 * (t - 5.0), 0.9]])
    return a


CASE = Case(
    name="flyby",
    problem=Complementarity(drift, (Distance(d=1.0, dim=2, anchors=anchors, pairs=[[0, 0]]),)),
    x0=np.array([0.0, 0.0]),
    t=np.linspace(0.0, 10.0, 21),
)
