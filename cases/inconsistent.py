"""A linear complementarity system whose start no multiplier makes consistent.

    x1' = -x1 + x2 + lam,   x2' = -x2,   w = x1 - level,   0 <= w _|_ lam >= 0,   x(0) = (0, 1), level = 1/2

D = 0, so w(0) = -level whatever lam is: the state would have to jump, and the system states no law for it (an impulse
along B, the nearest point, a jump that keeps energy: all have been proposed). What it is for: out of scope, every
method refuses it with a sentence instead of jumping in its own way.
"""
import numpy as np

from nsbench import LCS, Case

SUITES = {"full": [{}]}


def make(level: float = 0.5) -> Case:
    """level: how far the start is below the wall; positive."""
    if not level > 0:
        raise ValueError(f"level is {level!r}; a positive number is needed (else the start is consistent)")
    return Case(
        name="inconsistent",
        problem=LCS(A=[[-1, 1], [0, -1]], B=[[1], [0]], C=[[1, 0]], D=[[0]], q=lambda xp: lambda t: -level * xp.ones(1)),
        x0=np.array([0.0, 1.0]),
        t=np.linspace(0.0, 2.0, 21),
        tags=("lcs",),
    )
