"""Wind around a sphere in 3-D."""
import numpy as np

from nsbench import Case, Complementarity, Distance


def drift(xp):
    def f(t, x):
        return xp.array([1.0, 0.2 * xp.sin(t), -0.3 * x[2]])
    return f


CASE = Case(
    name="sphere_3d",
    problem=Complementarity(drift, (Distance(d=0.8, dim=3, anchors=np.array([[0.0, 0.0, 0.0]]), pairs=[[0, 0]]),)),
    x0=np.array([-2.0, 0.1, 0.2]),
    t=np.linspace(0.0, 9.0, 46),
)
