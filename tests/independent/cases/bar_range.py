"""Two particles at a distance between 0.8 and 1."""
import numpy as np

from nsbench import Case, Complementarity, Distance


def drift(xp):
    def f(t, x):
        return xp.array([xp.cos(2.0 * t), 0.3 * xp.sin(t), -xp.cos(2.0 * t), 0.5])
    return f


CASE = Case(
    name="bar_range",
    problem=Complementarity(
        drift,
        (
            Distance(d=0.8, sign=1, dim=2, pairs=[[0, 1]]),
            Distance(d=1.0, sign=-1, dim=2, pairs=[[0, 1]]),
        ),
    ),
    x0=np.array([0.0, 0.0, 0.85, 0.2]),
    t=np.linspace(0.0, 8.0, 41),
)
