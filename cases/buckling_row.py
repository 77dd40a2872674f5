"""Buckling row: n discs in a row, almost straight, are drawn to one point, pressed together, and buckle.

    x_i' = -x_i + sum_j lam_ij (x_i - x_j) / |x_i - x_j|,   g_ij = |x_i - x_j| - 2 >= 0

The discs start 2 + gap apart on a line, each off it by a random number of size `bend`. Once the row is closed, its load
is the parabola of `rods`, up to n^2/8, and the straight row is unstable: it folds up within a time of about 1 into a
heap of 2 to 3 rows, with some 140 events for n = 20.

What it is for: an instability that looks like a plateau. What a sweep leaves of the overlaps (about 0.09 n^3 h in the
state) is amplified as the row folds: for n = 20 PBD is 3 to 4 off, whatever its step, down to 800 steps, 2.1 at 1600, and
begins to converge only then: 0.39 at 6400, 0.05 at 102400 (measured, with bend = 1e-3). No closed form is known.
"""
import numpy as np

from nsbench import Case, Complementarity, Distance

SUITES = {"full": [{}, {"n": 6}]}


def drift(xp):
    def f(t, x):
        return -x
    return f


def make(n: int = 20, bend: float = 1e-3, seed: int = 0, gap: float = 0.1) -> Case:
    """n: discs; bend: how far off the line they start at most; gap: between neighbours at the start."""
    if not 3 <= n <= 1000:
        raise ValueError(f"n is {n!r}; 3 to 1000 discs")
    if not (gap > 0.0 and 0.0 <= bend <= 0.5):
        raise ValueError(f"bend is {bend!r}, gap {gap!r}; bend in [0, 0.5] and a positive gap are needed")
    along = (2.0 + gap) * (np.arange(n) - 0.5 * (n - 1))
    across = bend * np.random.default_rng(seed).uniform(-1.0, 1.0, n)
    return Case(
        name="buckling_row",
        problem=Complementarity(drift, (Distance(d=2.0),)),
        x0=np.stack((along, across), axis=1).ravel(),
        t=np.linspace(0.0, 2.0, 21),
        substeps=20, also=("pbd[order=reverse]",), radius=1.0,
    )
