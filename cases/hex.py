"""Hex: a hexagonal patch of discs shrinks to a point until all contacts close at one instant.

    x_i' = -x_i + sum_j lam_ij (x_i - x_j) / |x_i - x_j|,   g_ij = |x_i - x_j| - 2 >= 0

The start is the packing of touching discs, scaled by 3/2. Exact: it shrinks as a whole, x = 3/2 e^-t p, up to
t = ln(3/2), and then rests in the packing p, because p is a minimum of |x|^2 with all contacts closed.

7 discs have 12 contacts whose gradients have rank 11 (19: 42 and 35; 37: 90 and 71): the multipliers are not
unique, so no exact impulse is given. The reaction is unique, p per unit time. What a sweep returns depends on its
order; compared with the least-norm multiplier that looks like an error that never goes away, and it is none.
"""
import numpy as np

from nsbench import Case, Complementarity, Distance

SCALE = 1.5
RINGS = {7: 1, 19: 2, 37: 3}
SUITES = {"smoke": [{"n": 7}], "standard": [{"n": 7}, {"n": 19}], "full": [{"n": 37}]}


def packing(rings):
    """Centres of touching unit discs around one at the origin, row by row; (3 r (r + 1) + 1, 2)."""
    rows = [(q + 0.5 * r, r) for r in range(-rings, rings + 1)
            for q in range(max(-rings, -rings - r), min(rings, rings - r) + 1)]
    return np.array(rows) * [2.0, np.sqrt(3.0)]


def drift(xp):
    def f(t, x):
        return -x
    return f


def make(n: int = 7) -> Case:
    """n: 7, 19 or 37 discs."""
    if n not in RINGS:
        raise ValueError(f"n is {n!r}; one of {sorted(RINGS)}")
    closed = packing(RINGS[n]).ravel()

    def exact(t):
        return np.maximum(SCALE * np.exp(-t), 1.0)[:, None] * closed

    return Case(
        name="hex",
        problem=Complementarity(drift, (Distance(d=2.0),)),
        x0=SCALE * closed,
        t=np.linspace(0.0, 1.5, 31),
        exact=exact, exact_events=(np.log(SCALE),), substeps=8, radius=1.0,
        also=("pbd[order=reverse]", "pbd[order=random,seed=2]", "pbd[order=random,seed=5]"), tags=("redundant",),
    )
