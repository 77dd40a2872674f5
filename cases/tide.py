"""Tide: a point pushed against the floor, held, and released.

    y' = -cos t + lam,   0 <= y _|_ lam >= 0,   y(0) = 1/2

The simplest case with an impact, a rest and a release at known times. (The plain
falling apple cannot measure an order: Euler is exact for a constant drift.)
Exact: y = 1/2 - sin t up to t1 = pi/6, then y = 0 with lam = cos t up to t2 = pi/2,
then y = 1 - sin t.
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
    name="tide",
    problem=Complementarity(drift, (Affine(A=np.eye(1), b=np.zeros(1)),)),
    x0=np.array([0.5]),
    t=np.linspace(0.0, 3.0, 61),
    exact=exact, exact_impulse=exact_impulse, exact_events=(T1, T2),
    also=("catching_up[backend=osqp]", "catching_up[backend=piqp]", "theta[theta=0.5]"),
)
