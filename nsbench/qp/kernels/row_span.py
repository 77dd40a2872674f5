"""Span of sparse rows: which rows depend on others, and multipliers that hold all of them at zero.

Both by the sparse L D L^T factor of G G^T (linalg.sparse_ldl).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from nsbench.compilation.decorators import njit
from nsbench.linalg.sparse_ldl import choose, factor, lengths
from nsbench.qp.kernels.dual_active_set import EPS, NO_FACTOR, direction, equality

if TYPE_CHECKING:
    from nsbench.linalg.sparse_ldl import SparsityPattern


@njit(cache=True, error_model="numpy")
def in_span(
    P: SparsityPattern, vals: np.ndarray, support: np.ndarray, dependent: float
) -> np.ndarray:
    """Return (m,) for each row whether its squared sine against the independent rows `support` is
    at most `dependent`."""
    m = P.ptr.size - 1
    norm = lengths(P, vals)
    on = np.zeros(m, np.bool_)
    slot = np.empty(m, np.int64)
    for k in support:
        on[k] = True
    act = choose(on, P.order, slot)
    L, D = factor(act, slot, P.ptr, P.cols, vals, P.tptr, P.trow, P.tpos, NO_FACTOR, 0.0)
    # the squared distance of each row from the span, against its squared length
    for k in range(m):
        if not on[k]:
            _, gain = direction(k, act, L, D, P, vals, slot)
            on[k] = gain <= dependent * norm[k] * norm[k]
    return on


@njit(cache=True, error_model="numpy")
def hold(P: SparsityPattern, vals: np.ndarray, q: np.ndarray, n: int) -> np.ndarray:
    """Return mu (m,) with q + G G^T mu = 0 in every row, q (m,), n columns.

    NaN in the rows that depend on others.
    """
    m = q.size
    on = np.ones(m, np.bool_)
    slot = np.empty(m, np.int64)
    mu = np.empty(m)
    d = np.empty(n)
    w = np.empty(m)
    equality(on, P, vals, q, lengths(P, vals), NO_FACTOR, EPS, mu, d, w, slot)
    for k in range(m):
        if not on[k]:
            mu[k] = np.nan
    return mu
