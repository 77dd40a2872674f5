"""Three discs of different sizes."""
import numpy as np

from nsbench import Case, Complementarity, Distance


def drift(xp):
    def f(t, x):
        return xp.array(
            [
                -1.5 * x[0] + 0.5 * xp.sin(t),
                -x[1],
                -x[2],
                -1.5 * x[3] + 0.7 * xp.cos(1.3 * t),
                -x[4] + 0.4 * xp.cos(t),
                -x[5] - 0.3,
            ]
        )
    return f


CASE = Case(
    name="discs_radii",
    problem=Complementarity(drift, (Distance(radii=np.array([0.2, 0.5, 0.35]), dim=2),)),
    x0=np.array([-1.2, 0.2, 0.8, 0.5, 0.1, -1.0]),
    t=np.linspace(0.0, 8.0, 41),
)
