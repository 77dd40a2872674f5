"""Duplicate: tide with the same floor stated twice.

    y' = -cos t + lam1 + lam2,   0 <= y _|_ lam1 >= 0,   0 <= y _|_ lam2 >= 0,   y(0) = 1/2

Exact: the state of tide, y = 1/2 - sin t up to pi/6, 0 up to pi/2, then 1 - sin t. Only the sum lam1 + lam2 = cos t
is determined, so no exact impulse is given: the reaction y(t) - y(0) + sin t is what methods must agree on, and how
they share it between the two floors is their choice, not their error. One sweep gives all to the first.
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


CASE = Case(
    name="duplicate",
    problem=Complementarity(drift, (Affine(A=np.ones((2, 1)), b=np.zeros(2)),)),
    x0=np.array([0.5]),
    t=np.linspace(0.0, 3.0, 61),
    exact=exact, exact_events=(T1, T2), substeps=4, also=("pbd[order=reverse]",), tags=("redundant",),
)
