"""The modes of a Filippov system as corners of a box of signs, and whether its field is multilinear between them."""
from __future__ import annotations

from itertools import product

import numpy as np

from nsbench.problem import Filippov


def surfaces(problem: Filippov, n: int) -> int:
    """Their number."""
    return problem.d if problem.d is not None else len(problem.switch(np)(0.0, np.full(n, 0.37)))


def multilinear(problem: Filippov, n: int) -> bool:
    """Whether the field is what its corners make of it, at some points drawn once; False where it is not finite."""
    rng, field, d = np.random.default_rng(0), problem.field(np), surfaces(problem, n)
    with np.errstate(all="ignore"):
        for _ in range(4):
            t, x, s = rng.uniform(), rng.uniform(-1.0, 1.0, n), rng.uniform(-1.0, 1.0, d)
            values = np.array([field(t, x.copy(), q) for q in corners(d)])
            off = np.abs(np.prod(0.5 * (1.0 + corners(d) * s), axis=1) @ values - field(t, x.copy(), s))
            if not np.all(off <= 1e-12 * (1.0 + np.abs(values).max(axis=0))):
                return False
    return True


def corners(d: int) -> np.ndarray:
    """(2^d, d) signs."""
    return np.array(list(product((1.0, -1.0), repeat=d)))
