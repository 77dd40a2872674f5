"""Apple: a point that falls to the ground at constant speed and stays there.

    y' = -1 + lam,   0 <= y _|_ lam >= 0,   y(0) = 1,   T = 2

Exact: y = max(1 - t, 0); the ground carries lam = 1 from t = 1 on. The drift is constant, so Euler is exact at
grid times and the case shows no order: a bench must say so instead of fitting a slope through rounding. It is the
first picture of every talk on the subject; `tide` is the variant that ranks methods.
"""
import numpy as np

from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, y):
        return -xp.ones_like(y)
    return f


def exact(t):
    return np.maximum(1.0 - t, 0.0)[:, None]


def exact_impulse(t):
    return np.maximum(t - 1.0, 0.0)[:, None]


CASE = Case(
    name="apple",
    problem=Complementarity(drift, (Affine(A=np.eye(1), b=np.zeros(1)),)),
    x0=np.ones(1),
    t=np.linspace(0.0, 2.0, 41),
    exact=exact, exact_impulse=exact_impulse, exact_events=(1.0,),
    substeps=8, tags=("seed", "exact_at_grid"),
)
