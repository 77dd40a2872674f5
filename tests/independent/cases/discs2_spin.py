"""Two discs collide, turn around each other and part."""
import numpy as np

from nsbench import Case, Complementarity, Distance


def drift(xp):
    def f(t, x):
        return xp.array([0.8 * xp.cos(0.8 * t), 0.05, -0.8 * xp.cos(0.8 * t), -0.05 * xp.cos(t)])
    return f


CASE = Case(
    name="discs2_spin",
    problem=Complementarity(drift, (Distance(d=0.5, dim=2),)),
    x0=np.array([-0.6, 0.05, 0.6, -0.05]),
    t=np.linspace(0.0, 8.0, 41),
)
