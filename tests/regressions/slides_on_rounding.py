"""At 1e8 from the origin steps of 2e-6 are some spacings: implicit ones slid on what rounding
leaves of their equation."""

import numpy as np

from nsbench import Case, Filippov


def mode_p(xp):
    def f(t, x):
        x = x - 1e8
        return xp.array(
            [
                -0.3 * x[0] * x[2],
                0.206 * xp.sin(2.469 * x[1]) - 1.0 * xp.tanh(x[2]) - 0.5 * x[0] * x[0] * x[0],
                -1.103 * x[2] * x[2] * x[2] - 0.1641 * x[2] * x[2],
            ]
        )

    return f


def mode_m(xp):
    def f(t, x):
        x = x - 1e8
        return xp.array(
            [
                -0.118 * x[2]
                - 1.355 * xp.sin(4.436 * (t + 1.0) + 1.0)
                + 0.294 * xp.sin(0.99 * x[2]),
                2.0 * xp.sin(2.0 * x[0]) + 0.715 * xp.sin(2.0 * (t + 1.0) + 1.492),
                -1.379 * x[2] * x[2] * x[2] + 1.592 * xp.tanh(x[1]),
            ]
        )

    return f


def switch(xp):
    def f(t, x):
        x = x - 1e8
        return xp.array([x[0] - 0.183 * xp.sin(2.239 * (t + 1.0))])

    return f


CASE = Case(
    name="scene",
    problem=Filippov({(1,): mode_p, (-1,): mode_m}, switch),
    x0=np.array([100000000.0, 100000000.946, 100000000.766]),
    t=np.array(
        [
            -1.0,
            -0.9722932842246679,
            -0.920368721415685,
            -0.6432005489385144,
            -0.5671822167573555,
            -0.3159831097249477,
            -0.31425069155369356,
            -0.2556846813037734,
            -0.23553424907766685,
            -0.2349293944339772,
            -0.11271094520033631,
            -0.10437775791897486,
            0.009217113356429163,
            0.11159042913481487,
            0.5744154112275848,
            0.7267643051070372,
            0.819779380240661,
            0.8730182675550922,
            0.898233151858344,
            0.9663646705412423,
            1.0,
        ]
    ),
)

BY = ("euler[implicit=true]",)
