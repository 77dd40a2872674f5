"""Exact active-set solution of a projection QP as a C callback, best for few rows at work.

A file of its own: a C callback is compiled when its file is imported.
"""

import numpy as np

from nsbench.compilation.decorators import cfunc
from nsbench.linalg.sparse_ldl import SparsityPattern
from nsbench.qp.kernels import active_set
from nsbench.qp.kernels.dispatch import CODE, EXACT_SIGNATURE, ROUNDS


@cfunc(EXACT_SIGNATURE, cache=True, error_model="numpy")
def solve_exact(
    ptr: np.ndarray,
    cols: np.ndarray,
    tptr: np.ndarray,
    trow: np.ndarray,
    tpos: np.ndarray,
    order: np.ndarray,
    vals: np.ndarray,
    q: np.ndarray,
    guess: np.ndarray,
    scale: float,
    mu: np.ndarray,
    d: np.ndarray,
    work: np.ndarray,
) -> None:
    """Solve the projection QP exactly, to rounding, with a basic mu; fills mu (m,), d (n,) and
    work: see qp.kernels.dispatch."""
    multipliers, step, work[CODE], work[ROUNDS] = active_set.solve(
        SparsityPattern(ptr, cols, tptr, trow, tpos, order), vals, q, guess, scale
    )
    for k in range(mu.size):
        mu[k] = multipliers[k]
    for c in range(d.size):
        d[c] = step[c]
