"""Discs that blow up: SciPy's tree raised an error when the squares of their coordinates
overflowed."""

import numpy as np

from nsbench import Case, Complementarity, Distance


def drift(xp):
    def f(t, x):
        return 1e3 * x * x

    return f


CASE = Case(
    name="scene",
    problem=Complementarity(drift, (Distance(d=1.0, dim=2),)),
    x0=np.array([0.0, 0.3, 0.0, 1.4]),
    t=np.linspace(0.0, 2.0, 3),
)

BY = ("kdtree", "kdtree[sweep=numpy]")
