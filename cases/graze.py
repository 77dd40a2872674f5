"""Graze: a parabola that dips into the floor, touches it or just misses it.

    x' = (1, 2 x1) + lam (0, 1),   g = x2 >= 0,   x(0) = (-1, 1 + delta)

Exact: x1 = t - 1. For delta >= 0 the floor is never pressed on, x2 = x1^2 + delta; at delta = 0 it is touched at t = 1
for an instant, which is no event. For delta < 0 the point lands at x1 = -sqrt(-delta), is held with lam = -2 x1 up to
x1 = 0, where the force vanishes, and leaves tangentially: x2 = x1^2 from there on, impulse -delta.

What it is for: a late or early method has a contact of length O(sqrt h) where there is none, with multipliers of
O(sqrt h) and an impulse of O(h): order 1/2 in the supremum of lam, order 1 in L1, impulse and state. (Explicit Euler
passes at the depth h.) A method with large steps misses a contact of length sqrt(-delta) altogether; it must look
between its steps.
"""
import numpy as np

from nsbench import Affine, Case, Complementarity

SUITES = {"standard": [{}], "full": [{"delta": -0.02}, {"delta": 0.02}, {"delta": -1e-6}]}


def drift(xp):
    def f(t, x):
        return xp.array([1.0, 2.0 * x[0]])
    return f


def make(delta: float = 0.0) -> Case:
    """delta: by how much the parabola would miss the floor; negative for a contact, above -1."""
    if not -1.0 < delta < 10.0:
        raise ValueError(f"delta is {delta!r}; a number between -1 and 10")
    lands = -np.sqrt(max(-delta, 0.0))

    def exact(t):
        s = t - 1.0
        held = (s >= lands) & (s < 0.0) & (delta < 0.0)
        above = s * s + np.where((s < 0.0) | (delta >= 0.0), delta, 0.0)
        return np.stack((s, np.where(held, 0.0, above)), axis=1)

    def exact_impulse(t):
        return (lands**2 - np.clip(t - 1.0, lands, 0.0) ** 2)[:, None]

    return Case(
        name="graze",
        problem=Complementarity(drift, (Affine(np.array([[0.0, 1.0]]), np.zeros(1)),)),
        x0=np.array([-1.0, 1.0 + delta]),
        t=np.linspace(0.0, 2.0, 38),                    # no sample at the touch, t = 1
        exact=exact, exact_impulse=exact_impulse, exact_events=(1.0 + lands, 1.0) if delta < 0 else (), substeps=8,
    )
