"""Oscillator: a growing spiral that reverses its turn on the unit circle.

    x' = A1 x outside, A1 = [[1, w], [-w, 1]];   x' = A2 x inside, A2 = [[1, -w], [w, 1]];   w = 2 pi

The order case of finite elements with switch detection (FESD, arXiv 2205.05337): one transversal crossing
of a curved surface, at t = 1, between fields that vary fast. Swapping A1 and A2 flips the sign of x2.
Exact: x = e^(t-1) (cos wt, sin wt) up to t = 1, then e^(t-1) (cos w(t-1), -sin w(t-1)).
The end time pi/2 keeps the crossing off the sample times.
"""
import numpy as np

from nsbench import Case, Filippov

W = 2.0 * np.pi


def outside(xp):
    def f(t, x):
        return xp.array([x[0] + W * x[1], x[1] - W * x[0]])
    return f


def inside(xp):
    def f(t, x):
        return xp.array([x[0] - W * x[1], x[1] + W * x[0]])
    return f


def circle(xp):
    def c(t, x):
        return x[0:1] * x[0:1] + x[1:2] * x[1:2] - 1.0
    return c


def exact(t):
    turn = np.where(t < 1.0, W * t, -W * (t - 1.0))
    return np.exp(t - 1.0)[:, None] * np.stack([np.cos(turn), np.sin(turn)], 1)


def exact_impulse(t):
    return np.maximum(t - 1.0, 0.0)[:, None]


CASE = Case(
    name="oscillator",
    problem=Filippov({(+1,): outside, (-1,): inside}, circle),
    x0=np.array([np.exp(-1.0), 0.0]),
    t=np.linspace(0.0, np.pi / 2, 31),
    exact=exact, exact_impulse=exact_impulse, exact_events=(1.0,),
)
