"""A root of an event function was looked for across a pole in time, and hit it: the division by
zero ended the run."""

import numpy as np

from nsbench import Case, Filippov


def mode_pp(xp):
    def f(t, x):
        return xp.array(
            [
                -1.0 + -0.1773 * x[1] * x[1] + 0.15 * x[0] * x[0],
                1.399 * x[1] / (1.0 + x[0] * x[0]) + -1.72 / (t - -0.866),
            ]
        )

    return f


def mode_pm(xp):
    def f(t, x):
        return xp.array(
            [
                -0.771 * x[0] + 0.0 * x[0],
                xp.exp(0.702 * x[0]) + xp.minimum(xp.maximum(x[0], -0.5), 0.5),
            ]
        )

    return f


def mode_mp(xp):
    def f(t, x):
        return xp.array(
            [
                0.5 * x[0] / (1.0 + x[0] * x[0]) + 0.134 * xp.sin(2.763 * x[0]),
                -10000.0 * (x[0] - xp.cos(t - -1.0)) + 1.471 * xp.tanh(x[1]),
            ]
        )

    return f


def mode_mm(xp):
    def f(t, x):
        return xp.array([-1.552 / (t - 0.457) + -1.776 * x[0], -0.25 * xp.tanh(x[0])])

    return f


def switch(xp):
    def f(t, x):
        return xp.array([x[0] + 0.5 * x[0], x[0] - -0.016 * xp.sin(1.251 * (t - -1.0))])

    return f


CASE = Case(
    name="scene",
    problem=Filippov(
        {(1, 1): mode_pp, (1, -1): mode_pm, (-1, 1): mode_mp, (-1, -1): mode_mm}, switch
    ),
    x0=np.array([-1.0, 1.0]),
    t=np.array(
        [
            -1.0,
            -0.39295580567299393,
            -0.20168541607708002,
            0.04121706788722346,
            0.2983984875108945,
            1.990738138208564,
            2.1863767035778046,
            2.6446472313334386,
            2.994830039499825,
            3.902469597971101,
            4.0,
        ]
    ),
)

BY = ("event_driven", "event_driven[compiled=false]", "event_driven[method=lsoda]", "euler")
