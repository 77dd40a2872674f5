"""Modes of a Filippov system: 2^d sign patterns; is the field multilinear in the signs?

A field F(t, x, s) is multilinear in the signs s if it is affine in each of them. Then F between
the corners of the box [-1, 1]^d is the mean of its modes by product weights (Alexander & Seidman,
Houston J. Math. 24, 1998).
"""

from __future__ import annotations

from itertools import product

import numpy as np

from nsbench.compilation.factories import as_numpy
from nsbench.dynamics.filippov.switch_rates import evaluate_or_nan
from nsbench.problem import Filippov

ANY_COORDINATE = 0.37  # a state at which switches are counted; no round number
RANDOM_POINTS = 4  # (t, x, s) at which the field is compared with its interpolation
MULTILINEAR_ERROR = 1e-12  # of 1 + the fields of both sides: what rounding leaves


def count_surfaces(problem: Filippov, n: int) -> int:
    """Return the number d of switch functions of a Filippov system with n states."""
    if problem.d is not None:
        return problem.d
    return len(as_numpy(problem.switch)(0.0, np.full(n, ANY_COORDINATE)))


def is_multilinear(problem: Filippov, n: int) -> bool:
    """Is the field affine in each sign at some random points? False where it is not finite."""
    rng = np.random.default_rng(0)
    field = as_numpy(problem.field)
    d = count_surfaces(problem, n)
    with np.errstate(all="ignore"):
        for _ in range(RANDOM_POINTS):
            t = rng.uniform()
            x = rng.uniform(-1.0, 1.0, n)
            s = rng.uniform(-1.0, 1.0, d)
            f = evaluate_or_nan(field, t, x, s.copy())
            for i in range(d):
                plus, minus = (
                    evaluate_or_nan(field, t, x, np.where(np.arange(d) == i, e, s))
                    for e in (1.0, -1.0)
                )
                off = np.abs(0.5 * (1.0 + s[i]) * plus + 0.5 * (1.0 - s[i]) * minus - f)
                size = 1.0 + np.maximum(np.abs(plus), np.abs(minus))
                if not np.all(off <= MULTILINEAR_ERROR * size):
                    return False
    return True


def sign_patterns(d: int) -> np.ndarray:
    """Return (2^d, d) all patterns of signs +1 and -1, the positive ones first."""
    return np.array(list(product((1.0, -1.0), repeat=d)))
