"""Three discs meet at the same time and turn."""
import numpy as np

from nsbench import Case, Complementarity, Distance


def drift(xp):
    def f(t, x):
        return xp.array(
            [
                -x[0] - 0.7 * x[1],
                -x[1] + 0.7 * x[0],
                -x[2] - 0.7 * x[3],
                -x[3] + 0.7 * x[2],
                -x[4] - 0.7 * x[5],
                -x[5] + 0.7 * x[4],
            ]
        )
    return f


CASE = Case(
    name="three_symm",
    problem=Complementarity(drift, (Distance(d=0.6, dim=2),)),
    x0=np.array([1.0, 0.0, -0.5, 0.5 * np.sqrt(3.0), -0.5, -0.5 * np.sqrt(3.0)]),
    t=np.linspace(0.0, 4.0, 41),
)
