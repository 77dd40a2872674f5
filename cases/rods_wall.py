"""Rods at a wall: n unit rods on a line are blown against a wall and queue up there.

    x_i' = -a(t) + lam_i - lam_{i+1},   g_1 = x_1 - 1/2 >= 0,   g_i = x_i - x_{i-1} - 1 >= 0,   a = 1 + swell sin t

Exact, in the clock s(t), the integral of a: every rod travels at speed 1 until it meets the queue, x_i = max(x_i(0) - s,
i - 1/2), after as much as there was room before it. With m rods at rest contact i carries the m - i + 1 rods from i on,
so that in the end lam_i = a (n - i + 1); the impulses are piecewise linear in s.

What it is for: the order of the sweep. From the wall upwards (the order of the rows) each contact is left violated by
the next one, by h lam_{i+1}; from the top downwards (order = reverse) by the one before, h lam_{i-1}, and the wall, done
last, by nothing. Both are of first order, with constants that grow like n^2 in the state: a load passes one rod per
step. The end multipliers are known without any history.
"""
import numpy as np

from nsbench import Affine, Case, Complementarity

SUITES = {"standard": [{}], "full": [{"swell": 0.5}, {"n": 10}, {"n": 30}]}
GOLDEN = 0.5 * (5.0 ** 0.5 - 1.0)


def clock(t, swell):
    """s(t) = integral of 1 + swell sin."""
    return t + 2.0 * swell * np.sin(0.5 * t) ** 2


def when(s, swell):
    """The times at which the clock shows s; it is monotone for |swell| < 1."""
    t = s
    for _ in range(60):
        t = t - (clock(t, swell) - s) / (1.0 + swell * np.sin(t))
    return t


def make(n: int = 5, swell: float = 0.0) -> Case:
    """n: number of rods, at least 1; swell: how much the wind varies in time, in [0, 1)."""
    if n < 1:
        raise ValueError(f"n is {n!r}; at least 1 rod")
    if not 0.0 <= swell < 1.0:
        raise ValueError(f"swell is {swell!r}; at least 0 and below 1")
    rooms = (0.5 + np.mod(GOLDEN * np.arange(1, n + 1), 1.0)) / n       # no two alike, about 1 together
    at_rest = np.arange(n) + 0.5
    stops = np.cumsum(rooms)
    knots = np.concatenate(([0.0], stops, [stops[-1] + 100.0]))
    queue = np.arange(n + 1)[:, None]                   # rods at rest from that knot on
    loads = np.maximum(queue - np.arange(n), 0.0)
    pressed = np.vstack((np.zeros(n), np.cumsum(np.diff(knots)[:, None] * loads, axis=0)))

    def drift(xp):
        def f(t, x):
            return -(1.0 + swell * xp.sin(t)) * xp.ones_like(x)
        return f

    def exact(t):
        return np.maximum(at_rest + stops - clock(t, swell)[:, None], at_rest)

    def exact_impulse(t):
        return np.stack([np.interp(clock(t, swell), knots, p) for p in pressed.T], axis=1)

    rows = np.eye(n) - np.eye(n, k=-1)
    return Case(
        name="rods_wall",
        problem=Complementarity(drift, (Affine(rows, np.append(-0.5, -np.ones(n - 1))),)),
        x0=at_rest + stops,
        t=np.linspace(0.0, 2.0, 21),
        exact=exact, exact_impulse=exact_impulse, exact_events=tuple(when(stops, swell)),
        substeps=min(40, max(8, n * n // 3)),           # the sweep needs about n^2 steps to see through the queue
        also=("pbd[order=reverse]",), tags=() if swell else ("constant_force",),
    )
