"""Oscillator: a growing spiral that reverses its turn on the unit circle.

    x' = A1 x outside, A1 = [[1, w], [-w, 1]];   x' = A2 x inside, A2 = [[1, -w], [w, 1]];   w = 2 pi

The order case of finite elements with switch detection (FESD, arXiv 2205.05337): one transversal crossing
of a curved surface, at t = 1, between fields that vary fast. Swapping A1 and A2 mirrors the motion: x2 has the other
sign.
Exact: x = e^(t-1) (cos wt, sin wt) up to t = 1, then e^(t-1) (cos w(t-1), -sin w(t-1)).
The end time pi/2 keeps the crossing off the sample times.
"""
import numpy as np

from nsbench import Case, Filippov

SUITES = {"standard": [{}], "full": [{"swapped": True}]}
W = 2.0 * np.pi


def turning(sense):
    """Growth at rate 1 with a turn: clockwise for sense = 1."""
    def make(xp):
        def f(t, x):
            return xp.array([x[0] + sense * W * x[1], x[1] - sense * W * x[0]])
        return f
    return make


def circle(xp):
    def c(t, x):
        return x[0:1] * x[0:1] + x[1:2] * x[1:2] - 1.0
    return c


def exact_impulse(t):
    return np.maximum(t - 1.0, 0.0)[:, None]


def make(swapped: bool = False) -> Case:
    """swapped: A1 inside and A2 outside."""
    sense = -1.0 if swapped else 1.0

    def exact(t):
        turn = sense * np.where(t < 1.0, W * t, -W * (t - 1.0))
        return np.exp(t - 1.0)[:, None] * np.stack([np.cos(turn), np.sin(turn)], 1)

    return Case(
        name="oscillator",
        problem=Filippov({(+1,): turning(sense), (-1,): turning(-sense)}, circle),
        x0=np.array([np.exp(-1.0), 0.0]),
        t=np.linspace(0.0, np.pi / 2, 31),
        exact=exact, exact_impulse=exact_impulse, exact_events=(1.0,),
    )
