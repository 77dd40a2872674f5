"""A rope of length 1 to a fixed anchor, turning wind."""
import numpy as np

from nsbench import Case, Complementarity, Distance


def drift(xp):
    def f(t, x):
        return xp.array([xp.cos(t), xp.sin(1.3 * t)])
    return f


CASE = Case(
    name="rope_fixed",
    problem=Complementarity(drift, (Distance(d=1.0, sign=-1, dim=2, anchors=np.array([[0.2, -0.1]]), pairs=[[0, 0]]),)),
    x0=np.array([0.3, 0.3]),
    t=np.linspace(0.0, 14.0, 57),
)
