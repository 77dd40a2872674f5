"""Chua's circuit, whose diode switches between slopes: a flow that amplifies errors."""

import numpy as np

from nsbench import Case, Filippov

ALPHA = 9.0
BETA = 14.286
INNER = -1.0 / 7.0
OUTER = 2.0 / 7.0


def slope(g, offset):
    def make(xp):
        def f(t, x):
            diode = g * x[0] + offset
            return xp.array([ALPHA * (x[1] - diode), x[0] - x[1] + x[2], -BETA * x[1]])

        return f

    return make


def switch(xp):
    def c(t, x):
        return xp.array([x[0] - 1.0, x[0] + 1.0])

    return c


def chua(end):
    """From close to the unstable equilibrium; errors grow by some e^(0.4 t)."""
    inner = slope(INNER, 0.0)
    modes = {
        (1, 1): slope(OUTER, INNER - OUTER),
        (-1, 1): inner,
        (1, -1): inner,
        (-1, -1): slope(OUTER, OUTER - INNER),
    }
    start = np.array([0.1, 0.05, -0.02])
    t = np.linspace(0.0, end, 41)
    return Case(name="chua", problem=Filippov(modes, switch), x0=start, t=t)
