"""A drift that jumps between samples: no defect of the run, but one of the quadrature that judges
it."""

import numpy as np

from nsbench import Case, Complementarity


def drift(xp):
    def f(t, x):
        return xp.array([xp.where(t < -0.193, 2.0, -1.5) - 0.5 * x[0] * x[0]])

    return f


CASE = Case(
    name="scene",
    problem=Complementarity(drift),
    x0=np.array([0.5]),
    t=np.linspace(-1.0, 1.0, 6),
)

BY = ("event_driven",)
