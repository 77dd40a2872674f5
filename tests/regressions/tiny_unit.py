"""Discs in units of 1e-8: the absolute tolerances of a library for quadratic programs were a tenth
of their speeds."""

import numpy as np

from nsbench import Case, Complementarity, Distance


def drift(xp):
    def f(t, x):
        x = x / 1e-8
        return 1e-8 * xp.array(
            [
                1.0 - 0.4 * x[0],
                0.1 * xp.sin(t) - 0.4 * x[1],
                -0.5 * x[2],
                -0.4 * x[3],
                -1.0 - 0.4 * x[4],
                -0.4 * x[5],
            ]
        )

    return f


CASE = Case(
    name="scene",
    problem=Complementarity(drift, (Distance(d=1e-8, dim=2),)),
    x0=1e-8 * np.array([-1.0, 0.0, 0.0, 0.0, 1.0, 0.1]),
    t=np.linspace(0.0, 1.0, 6),
)

BY = ("catching_up[backend=piqp]", "catching_up[backend=osqp]")
