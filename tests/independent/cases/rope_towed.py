"""A rope towed by a moving anchor against friction."""
import numpy as np

from nsbench import Case, Complementarity, Distance


def drift(xp):
    def f(t, x):
        return xp.array([-0.4 * x[0] + 0.5 * xp.sin(3.0 * t), -0.4 * x[1] - 0.2])
    return f


def anchors(xp):
    def a(t):
        return xp.array([[1.5 * xp.cos(t), xp.sin(t)]])
    return a


CASE = Case(
    name="rope_towed",
    problem=Complementarity(drift, (Distance(d=0.7, sign=-1, dim=2, anchors=anchors, pairs=[[0, 0]]),)),
    x0=np.array([1.2, -0.1]),
    t=np.linspace(0.0, 12.0, 49),
)
