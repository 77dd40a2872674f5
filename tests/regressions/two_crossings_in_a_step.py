"""Two surfaces met in one long step: where rounding put the root at zero behind that at zero less
what is a touch, the second one was taken for met at the step's start, and so before the first."""

import numpy as np

from nsbench import Case, Filippov


def mode_pp(xp):
    def f(t, x):
        return xp.array([-2.0 * x[0] * x[0] * x[0]])

    return f


def mode_pm(xp):
    def f(t, x):
        return xp.array([1.491 * x[0] + -0.378 * t + 0.5 * xp.tanh(x[0])])

    return f


def mode_mp(xp):
    def f(t, x):
        return xp.array([-0.1218 * x[0] * x[0]])

    return f


def mode_mm(xp):
    def f(t, x):
        return xp.array([1.592 * t + 2.0 * t])

    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0] * x[0] * x[0], x[0] * x[0] + x[0] * x[0] - 0.5])

    return f


CASE = Case(
    name="scene",
    problem=Filippov(
        {(1, 1): mode_pp, (1, -1): mode_pm, (-1, 1): mode_mp, (-1, -1): mode_mm}, switch
    ),
    x0=np.array([-0.387]),
    t=np.linspace(0.0, 5.0, 2),
)

BY = ("event_driven", "event_driven[method=radau]")
