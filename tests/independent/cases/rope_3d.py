"""Two particles in 3-D on a rope and a leash."""
import numpy as np

from nsbench import Case, Complementarity, Distance


def drift(xp):
    def f(t, x):
        return xp.array([xp.cos(t), 0.4 * xp.sin(2.0 * t), -0.5, -0.6 * xp.sin(t), xp.cos(1.2 * t), 0.3 * xp.cos(t) - 0.1 * x[5]])
    return f


CASE = Case(
    name="rope_3d",
    problem=Complementarity(
        drift,
        (
            Distance(d=1.0, sign=-1, dim=3, anchors=np.array([[0.0, 0.0, 0.0]]), pairs=[[0, 0]]),
            Distance(d=0.8, sign=-1, dim=3, pairs=[[0, 1]]),
        ),
    ),
    x0=np.array([0.1, 0.0, 0.1, 0.5, 0.1, 0.0]),
    t=np.linspace(0.0, 10.0, 41),
)
