"""A diode that begins to act in the first interval: means over samples were wrong by its kink, and
passed for a depth."""

import numpy as np

from nsbench import LCS, Case


def u(xp):
    def f(t):
        return xp.array([-30.0 * (t - xp.cos(t)) - 0.45, -1.7 * t])

    return f


def q(xp):
    def f(t):
        return xp.array([0.61 - xp.sin(3.8 * t), xp.sin(1.46 * t)])

    return f


CASE = Case(
    name="scene",
    problem=LCS(
        np.array([[0.944, 0.888], [-0.365, -0.92]]),
        np.array([[0.862, -1.0], [-0.153, 0.54]]),
        np.array([[0.862, -0.153], [-1.0, 0.54]]),
        np.array([[1.0, 0.0], [0.0, 0.0]]),
        u=u,
        q=q,
    ),
    x0=np.array([0.0, 0.659]),
    t=np.linspace(0.0, 1.0, 6),
)

BY = ("theta", "theta[theta=0.5]")
