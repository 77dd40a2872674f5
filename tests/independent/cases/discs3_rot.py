"""Three discs pulled together, turning and shaken."""
import numpy as np

from nsbench import Case, Complementarity, Distance


def drift(xp):
    def f(t, x):
        c = xp.cos(t)
        s = xp.sin(2.0 * t)
        return xp.array(
            [
                -x[0] - 0.5 * x[1] + 0.8 * c,
                -x[1] + 0.5 * x[0],
                -x[2] - 0.5 * x[3],
                -x[3] + 0.5 * x[2] + 0.9 * s,
                -x[4] - 0.5 * x[5] - 0.7 * c,
                -x[5] + 0.5 * x[4] - 0.6 * s,
            ]
        )
    return f


CASE = Case(
    name="discs3_rot",
    problem=Complementarity(drift, (Distance(d=0.6, dim=2),)),
    x0=np.array([-1.0, 0.1, 0.9, 0.3, 0.2, -1.1]),
    t=np.linspace(0.0, 10.0, 41),
)
