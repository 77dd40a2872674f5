"""A chain of three links from an anchor, pulled by a turning force."""
import numpy as np

from nsbench import Case, Complementarity, Distance


def drift(xp):
    def f(t, x):
        c = xp.cos(0.8 * t)
        s = xp.sin(0.8 * t)
        return xp.array([0.3 * c, 0.3 * s, 0.3 * c - 0.1, 0.3 * s, 1.2 * c, 1.2 * s])
    return f


CASE = Case(
    name="chain3",
    problem=Complementarity(
        drift,
        (
            Distance(d=1.0, sign=-1, dim=2, anchors=np.array([[0.0, 0.0]]), pairs=[[0, 0]]),
            Distance(d=1.0, sign=-1, dim=2, pairs=[[0, 1], [1, 2]]),
        ),
    ),
    x0=np.array([0.5, 0.1, 1.1, 0.3, 1.8, 0.2]),
    t=np.linspace(0.0, 8.0, 41),
)
