"""Multipliers of contacts by their unit gradients: damped Gram systems, factored in their envelope.

A gradient has few entries, mostly of one or two particles: row k of the gradients at a state has
count[k] entries V[k, e] in the columns C[k, e]. Arrays V (K, m, w) of K states that have the same
gradients hold them once, K = 1.
"""

import numpy as np

from nsbench.compilation.decorators import inner_kernel, njit
from nsbench.linalg.skyline_cholesky import arrange, factor, fill, solve

PIVOTS = 8  # rounds of block pivoting
OPENS = 10.0  # times the damping: a rate at which a contact opens that is more than rounding


@inner_kernel
def _add_back(C, V, count, m, q, out):
    """Add N^T q to out (n,)."""
    for k in range(m):
        for e in range(count[k]):
            out[C[k, e]] += V[k, e] * q[k]


@inner_kernel
def _times(C, V, count, k, d):
    """Return row k of N d."""
    s = 0.0
    for e in range(count[k]):
        s += V[k, e] * d[C[k, e]]
    return s


@inner_kernel
def _factored(plan, C, V, count, m, damping, zeros, E):
    """Fill E with the factor of N N^T + damping; returns False if it is not positive.

    zeros (n,): zeros, which it leaves.
    """
    _, _, ends, _, _ = plan
    fill(plan, C, V, count, m, zeros, E)
    for i in range(m):
        E[ends[i + 1] - 1] += damping
    return factor(plan, m, E, 0.0)


@inner_kernel
def _solved(plan, C, V, count, m, n, E, is_refined, g, q):
    """Fill q (m,) with the solution for g (m,), by the factor E; is_refined: with one step of
    iterative refinement against N N^T without damping."""
    solve(plan, m, E, g, q)
    if not is_refined:
        return
    along = np.zeros(n)
    _add_back(C, V, count, m, q, along)
    lack = np.empty(m)
    for k in range(m):
        lack[k] = g[k] - _times(C, V, count, k, along)
    solve(plan, m, E, lack, lack)
    for k in range(m):
        q[k] += lack[k]


@njit(cache=True, error_model="numpy")
def gram_multipliers(
    C: np.ndarray,
    V: np.ndarray,
    count: np.ndarray,
    n: int,
    g: np.ndarray,
    damping: float,
    is_refined: bool,
    q: np.ndarray,
) -> bool:
    """Fill q (K, m) with the solutions of (N N^T + damping) q = g, for g (K, m).

    C (m, w), V (K or 1, m, w), count (m,): unit gradients in n coordinates. is_refined: with one
    step of iterative refinement against N N^T. Returns False if a matrix is not positive.
    """
    m = len(C)
    plan = arrange(C, count, m, n)
    _, _, ends, _, _ = plan
    E = np.empty(ends[m])
    zeros = np.zeros(n)
    for s in range(len(g)):
        at = s if len(V) > 1 else 0
        if at == s and not _factored(plan, C, V[at], count, m, damping, zeros, E):
            return False
        _solved(plan, C, V[at], count, m, n, E, is_refined, g[s], q[s])
    return True


@njit(cache=True, error_model="numpy")
def times(C: np.ndarray, V: np.ndarray, count: np.ndarray, d: np.ndarray, out: np.ndarray) -> None:
    """Fill out (K, m) with N d, for d (K, n) and unit gradients as in gram_multipliers."""
    for s in range(len(d)):
        at = s if len(V) > 1 else 0
        for k in range(len(C)):
            out[s, k] = _times(C, V[at], count, k, d[s])


@njit(cache=True, error_model="numpy")
def add_back(
    C: np.ndarray, V: np.ndarray, count: np.ndarray, q: np.ndarray, out: np.ndarray
) -> None:
    """Add N^T q to out (K, n), for q (K, m) and unit gradients as in gram_multipliers."""
    for s in range(len(q)):
        _add_back(C, V[s if len(V) > 1 else 0], count, len(C), q[s], out[s])


@inner_kernel
def _least_squares(C, V, count, n, pushes, d, damping, is_refined, q):
    """Fill q (m,) with the multipliers of the rows `pushes` (m,) that make d - N^T q shortest, 0.0
    for the others. Returns False if their Gram matrix is not positive."""
    some = np.flatnonzero(pushes)
    p = len(some)
    q[:] = 0.0
    if p == 0:
        return True
    columns = np.empty((p, C.shape[1]), np.int64)
    values = np.empty((p, C.shape[1]))
    length = np.empty(p, np.int64)
    g = np.empty(p)
    for a in range(p):
        k = some[a]
        length[a] = count[k]
        g[a] = _times(C, V, count, k, d)
        for e in range(C.shape[1]):
            columns[a, e] = C[k, e]
            values[a, e] = V[k, e]
    plan = arrange(columns, length, p, n)
    _, _, ends, _, _ = plan
    E = np.empty(ends[p])
    if not _factored(plan, columns, values, length, p, damping, np.zeros(n), E):
        return False
    found = np.empty(p)
    _solved(plan, columns, values, length, p, n, E, is_refined, g, found)
    for a in range(p):
        q[some[a]] = found[a]
    return True


@inner_kernel
def _mark_wrong(C, V, count, pushes, d, damping, q, rest, wrong):
    """Fill rest (n,) with d - N^T q, and wrong (m,): rows with q < 0, and rows that do not push and
    along which the rest opens nothing but closes. Returns how many are wrong."""
    size = 0.0
    for c in range(len(d)):
        rest[c] = -d[c]
        size += d[c] * d[c]
    _add_back(C, V, count, len(C), q, rest)
    for c in range(len(d)):
        rest[c] = -rest[c]
    most = OPENS * damping * np.sqrt(size)
    found = 0
    for k in range(len(C)):
        wrong[k] = q[k] < 0.0 or (not pushes[k] and _times(C, V, count, k, rest) > most)
        found += wrong[k]
    return found


@inner_kernel
def _pivoted(C, V, count, n, pushes, d, damping, q, rest, wrong):
    """Fill q (m,) >= 0 such that rest = d - N^T q is shortest; returns False without success.

    pushes (m,): a guess of the rows with q > 0, tried first, and overwritten. Without one all rows
    are tried. Then all rows on the wrong side change sides at once (block pivoting: Portugal,
    Judice & Vicente, Math. Comp. 63, 1994), which can cycle.
    """
    for r in range(2 + PIVOTS):
        for k in range(len(C)):
            if r == 1:
                pushes[k] = True
            elif r == 2:
                pushes[k] = q[k] > 0.0
            elif r > 2:
                pushes[k] = pushes[k] != wrong[k]
        if r == 0 and not np.any(pushes):
            continue
        if _least_squares(C, V, count, n, pushes, d, damping, r > 1, q):
            if _mark_wrong(C, V, count, pushes, d, damping, q, rest, wrong) == 0:
                return True
        elif r > 0:
            return False
    return False


@njit(cache=True, error_model="numpy")
def split_off_cone(
    C: np.ndarray,
    V: np.ndarray,
    count: np.ndarray,
    d: np.ndarray,
    pushes: np.ndarray,
    damping: float,
    q: np.ndarray,
    rest: np.ndarray,
) -> np.ndarray:
    """Fill q (K, m) >= 0 and rest (K, n) such that d = N^T q + rest with the shortest rest.

    d (K, n); unit gradients as in gram_multipliers. pushes (K, m): a guess of the rows with q > 0,
    replaced by those that have it; none is no guess. Returns (K,): was it found?
    """
    found = np.empty(len(d), np.bool_)
    wrong = np.empty(len(C), np.bool_)
    n = d.shape[1]
    for s in range(len(d)):
        at = s if len(V) > 1 else 0
        found[s] = _pivoted(C, V[at], count, n, pushes[s], d[s], damping, q[s], rest[s], wrong)
        for k in range(len(C)):
            pushes[s, k] = q[s, k] > 0.0
    return found
