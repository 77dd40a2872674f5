"""Sweep of exact projections over listed pairs of particles, as a user of numba writes it."""

from __future__ import annotations

import numpy as np

from nsbench.compilation.decorators import njit


@njit(cache=True, error_model="numpy")
def sweep(x: np.ndarray, pairs: np.ndarray, d: float, impulse: np.ndarray) -> float:
    """Move the pairs (p, 2) of particles x (n, dim) that are nearer than d apart to d, one after
    the other, in place.

    impulse (p,): how far each particle of the pair is moved along the normal. Returns the sum of
    all.
    """
    total = 0.0
    # Gauss-Seidel sweep: each projection starts from where the last one left the particles.
    for k in range(pairs.shape[0]):
        i = pairs[k, 0]
        j = pairs[k, 1]
        r2 = 0.0
        for c in range(x.shape[1]):
            r2 += (x[i, c] - x[j, c]) ** 2
        impulse[k] = 0.0
        if r2 < d * d and r2 > 0.0:
            r = np.sqrt(r2)
            m = 0.5 * (d - r)
            for c in range(x.shape[1]):
                e = m / r * (x[i, c] - x[j, c])
                x[i, c] += e
                x[j, c] -= e
            impulse[k] = m
            total += m
    return total
