"""Overlapping start: discs that begin inside each other, and what a method makes of that.

    x_i' = -x_i + contact forces,   g_ij = |x_i - x_j| - 2 >= 0,   g_ij(0) < 0 for some pairs

The system has no solution from such a start: a reaction is defined on the feasible set alone. So the case says what
is meant. "error": the start is a mistake, every method must refuse it and name the pair. "project": the motion begins
at the nearest feasible point, as a sweeping process with a jump at t = 0. "keep": it is left to the method. PBD pushes
the pairs apart one by one in its first step, one sweep not being enough for all; catching up solves its linearised
problem at the given point; a penalty lets them relax within a time of 1/k; a method that follows active sets refuses.

What it is for: robustness, not convergence. There is no error to be measured with "keep"; a method may refuse, it may
separate the discs its own way, it may not return overlapping discs and call that a solution. All discs may even share
one centre (spread = 0), where no direction of separation exists: projections have to choose one, and say so.
"""
import numpy as np

from nsbench import Case, Complementarity, Distance

SUITES = {"hard": [{"spread": 0.0}], "full": [{}, {"meaning": "project"}]}
MEANINGS = ("keep", "project", "error")


def drift(xp):
    def f(t, x):
        return -x
    return f


def make(n: int = 6, seed: int = 0, meaning: str = "keep", spread: float = 1.5) -> Case:
    """n discs at random in a square of half side spread * sqrt(n) / 2; meaning of the overlaps: see the module."""
    if meaning not in MEANINGS:
        raise ValueError(f"meaning is {meaning!r}; one of {', '.join(MEANINGS)}")
    if not 2 <= n <= 1000:
        raise ValueError(f"n is {n!r}; 2 to 1000 discs")
    if not 0.0 <= spread <= 2.0:
        raise ValueError(f"spread is {spread!r}; 0 to 2, beyond which discs need not overlap")
    x0 = np.random.default_rng(seed).uniform(-0.5, 0.5, 2 * n) * spread * np.sqrt(n)
    return Case(
        name="overlap_start",
        problem=Complementarity(drift, (Distance(d=2.0),)),
        x0=x0,
        t=np.linspace(0.0, 1.0, 11),
        start=meaning, substeps=8, radius=1.0, tags=("infeasible_start",),
    )
