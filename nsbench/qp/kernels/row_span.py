"""Which sparse rows lie in the span of others (patterns of kernels.qp)."""

import numpy as np

from nsbench.compilation.decorators import njit
from nsbench.linalg.sparse_ldl import choose, factor, lengths
from nsbench.qp.kernels.dual_active_set import EPS, NO_FACTOR, direction, equality


@njit(cache=True, error_model="numpy")
def in_span(P, vals, support, dependent):
    """(m,) whether the squared sine of each row against the independent rows `support` is at most
    `dependent`."""
    m = P[0].size - 1
    norm = lengths(P, vals)
    on = np.zeros(m, np.bool_)
    slot = np.empty(m, np.int64)
    for k in support:
        on[k] = True
    act = choose(on, P[5], slot)
    L, D = factor(act, slot, P[0], P[1], vals, P[2], P[3], P[4], NO_FACTOR, 0.0)
    for k in range(m):
        if not on[k]:
            _, gain = direction(k, act, L, D, P, vals, slot)
            on[k] = gain <= dependent * norm[k] * norm[k]
    return on


@njit(cache=True, error_model="numpy")
def hold(P, vals, q, n):
    """(m,) mu with q + G G^T mu = 0 in every row; NaN if the rows depend on each other."""
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
