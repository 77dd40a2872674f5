"""Exact active-set solution of a projection QP as a C callback, best for few rows at work.

A file of its own: a C callback is compiled when its file is imported.
"""

from nsbench.compilation.decorators import cfunc
from nsbench.linalg.sparse_ldl import SparsityPattern
from nsbench.qp.kernels import active_set
from nsbench.qp.kernels.dispatch import CODE, EXACT_SIGNATURE, ROUNDS


@cfunc(EXACT_SIGNATURE, cache=True, error_model="numpy")
def solve_exact(ptr, cols, tptr, trow, tpos, order, vals, q, guess, scale, mu, d, work):
    """Solve the projection QP exactly, to rounding, with a basic mu; fills mu (m,), d (n,) and
    work: see qp.kernels.dispatch."""
    multipliers, step, work[CODE], work[ROUNDS] = active_set.solve(
        SparsityPattern(ptr, cols, tptr, trow, tpos, order), vals, q, guess, scale
    )
    for k in range(mu.size):
        mu[k] = multipliers[k]
    for c in range(d.size):
        d[c] = step[c]
