"""Two switches of one surface, on which the state slides until both fields leave it: looked for on
single surfaces alone."""

import numpy as np

from nsbench import Case, Filippov


def field(xp):
    def f(t, x, s):
        return xp.array(
            [
                0.5 * xp.tanh(x[0])
                + s[0]
                * (
                    -1.0 * x[0] / (1.0 + x[0] * x[0])
                    + 1.952 * (t - -1.0)
                    + -1.495 * xp.sin(2.256 * (t - -1.0) + 1.051)
                )
                + 0.209 * s[0]
            ]
        )

    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0] * x[0] * x[0], 1000.0 * (x[0] * x[0] * x[0])])

    return f


CASE = Case(
    name="scene",
    problem=Filippov.signs(field, switch),
    x0=np.array([-0.189]),
    t=np.linspace(-1.0, 0.0, 2),
)

BY = ("event_driven", "euler", "penalty", "penalty[extrapolate=1]")
