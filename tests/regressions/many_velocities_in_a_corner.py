"""Explicit steps alternate between four modes in a corner, where velocities are many, and said
ok."""

import numpy as np

from nsbench import Case, Filippov


def mode_pp(xp):
    def f(t, x):
        return xp.array([-0.02, 1.343 * x[0], -0.5 * xp.tanh(x[1]) + 0.5 * x[2] - 0.5])

    return f


def mode_pm(xp):
    def f(t, x):
        return xp.array(
            [2.0 * x[1] + 1.311 * xp.sin(1.019 * x[1]), x[1], x[1] - 1.964 * xp.tanh(x[2])]
        )

    return f


def mode_mp(xp):
    def f(t, x):
        return xp.array(
            [
                0.442 - 0.334 * xp.sin(0.5 * t + 0.934),
                -xp.sin(2.669 * t + 2.0),
                0.5 * xp.sin(3.054 * x[1]),
            ]
        )

    return f


def mode_mm(xp):
    def f(t, x):
        return xp.array([-0.338 * x[2], 0.0 * t - 0.5, -0.5 * x[1] / (1.0 + x[2] * x[2])])

    return f


def switch(xp):
    def f(t, x):
        return xp.array([xp.sin(9.0 * x[0]), x[2]])

    return f


CASE = Case(
    name="scene",
    problem=Filippov(
        {(1, 1): mode_pp, (1, -1): mode_pm, (-1, 1): mode_mp, (-1, -1): mode_mm}, switch
    ),
    x0=np.array([0.0, -0.2, 1e-12]),
    t=np.linspace(0.0, 0.7, 6),
)

BY = ("euler", "euler[implicit=true]")
