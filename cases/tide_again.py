"""Tide again: the tide, watched until the point touches the floor once more, tangentially.

    y' = -cos t + lam,   0 <= y _|_ lam >= 0,   y(0) = 1/2,   T = 9

Exact: as in `tide`: y = 1/2 - sin t up to pi/6, 0 up to pi/2, then 1 - sin t. At t = 5 pi/2 this is zero again with
velocity zero: the floor is touched for an instant and no impulse is exchanged, so this is no event. What it is for:
a method that is late by h touches the floor or not as it happens; a real contact of length O(sqrt h) may appear and
must cost O(h) only.
"""
import numpy as np

from nsbench import Affine, Case, Complementarity

T1, T2 = np.pi / 6, np.pi / 2


def drift(xp):
    def f(t, y):
        return -xp.cos(t) * xp.ones_like(y)
    return f


def exact(t):
    return np.where(t < T1, 0.5 - np.sin(t), np.where(t < T2, 0.0, 1.0 - np.sin(t)))[:, None]


def exact_impulse(t):
    return (np.sin(np.clip(t, T1, T2)) - np.sin(T1))[:, None]


CASE = Case(
    name="tide_again",
    problem=Complementarity(drift, (Affine(A=np.eye(1), b=np.zeros(1)),)),
    x0=np.array([0.5]),
    t=np.linspace(0.0, 9.0, 61),
    exact=exact, exact_impulse=exact_impulse, exact_events=(T1, T2), substeps=8,
)
SUITES = {"full": [{}]}
