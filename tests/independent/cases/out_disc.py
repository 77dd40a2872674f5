"""Wind around a disc: release at the top."""
import numpy as np

from nsbench import Case, Complementarity, Distance


def drift(xp):
    def f(t, x):
        return xp.array([1.0, 0.0])
    return f


CASE = Case(
    name="out_disc",
    problem=Complementarity(drift, (Distance(d=1.0, dim=2, anchors=np.array([[0.0, 0.0]]), pairs=[[0, 0]]),)),
    x0=np.array([-3.0, 0.2]),
    t=np.linspace(0.0, 8.0, 41),
)
