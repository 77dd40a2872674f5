"""Fields of every operation that event_driven traces, and a crossing: all in closed form.

    p' = p^(3/2), a' = |cos 2t|, b' = table(t), c' = 3t - floor(3t), e' = log(2 + t) + arctan t,
    h' = (3 + s) / 4 cosh t, k' = 1 / cosh(t)^2 + sin(2t) + tanh t + exp(-t), v' = 0.7

s is the sign of v. With `torn` there is also m' = sign(m) from m = 0 by `where`, no Filippov
system: both signs go on, which is told. A case of the gate's studies: no case of the catalogue has
kinks, powers or tables.
"""

from functools import partial

import numpy as np

from nsbench import Case, Filippov

KNOTS = (0.0, 0.5, 1.2, 2.0)
HEIGHTS = (1.0, -0.5, 0.8, 0.2)
CROSSED = 0.9  # time at which v = 0


def field(xp, torn=False):
    knots = xp.array(KNOTS)
    heights = xp.array(HEIGHTS)

    def f(t, x, s):
        side = 0.75 + 0.25 * s[0]
        jump = (xp.where(x[8] > 0.0, 1.0, -1.0),) if torn else ()
        return xp.stack(
            (
                x[0] ** 1.5,
                xp.abs(xp.cos(2.0 * t)),
                xp.interp(t, knots, heights),
                3.0 * t % 1.0,
                xp.log(2.0 + t) + xp.arctan(t),
                side * xp.cosh(t),
                1.0 / xp.cosh(t) ** 2 + xp.sin(2.0 * t) + xp.tanh(t) + xp.exp(-t),
                0.7 + 0.0 * t,
                *jump,
            )
        )

    return f


def switch(xp):
    return lambda t, x: x[7:8]


def exact(t):
    """States (k, 8) at the times t (k,)."""
    t = np.asarray(t, float)
    quarter = np.floor(2.0 * t / np.pi + 0.5)
    waves = 0.5 * (2.0 * quarter + (-1.0) ** quarter * np.sin(2.0 * t))
    table = np.zeros_like(t)
    for a, b, u, v in zip(KNOTS, KNOTS[1:], HEIGHTS, HEIGHTS[1:], strict=False):
        part = np.clip(t, a, b) - a
        table = table + u * part + (v - u) / (b - a) * part**2 / 2.0
    teeth = np.floor(3.0 * t)
    ramp = (teeth + (3.0 * t - teeth) ** 2) / 6.0
    logs = (2.0 + t) * np.log(2.0 + t) - t - 2.0 * np.log(2.0)
    arcs = t * np.arctan(t) - 0.5 * np.log(1.0 + t * t)
    sides = np.where(t < CROSSED, 0.5 * np.sinh(t), np.sinh(t) - 0.5 * np.sinh(CROSSED))
    mixed = np.tanh(t) + np.sin(t) ** 2 + np.log(np.cosh(t)) + 1.0 - np.exp(-t)
    power = 1.0 / (2.0 - 0.5 * t) ** 2
    return np.stack(
        (power, waves, table, ramp, logs + arcs, sides, mixed, 0.7 * (t - CROSSED)), axis=-1
    )


def exact_impulse(t):
    """Integral of the sign's positive part (k, 1) at the times t (k,)."""
    return np.maximum(np.asarray(t, float) - CROSSED, 0.0)[..., None]


def make(torn: bool = False) -> Case:
    """Return the case over two units of time; torn: no motion from its start is the only one."""
    start = exact(0.0)
    return Case(
        name="kinked_fields",
        problem=Filippov(None, switch, partial(field, torn=torn), 1),
        x0=np.append(start, 0.0) if torn else start,
        t=np.linspace(0.0, 2.0, 33),
        exact=None if torn else exact,
        exact_impulse=None if torn else exact_impulse,
    )
