"""Projection on the cone of contact gradients: multipliers that are not negative.

Unit gradients C, V (m, w), count (m,) are those of one state (nsbench.error_bars.kernels.gram).
"""

import numpy as np

from nsbench.compilation.decorators import inner_kernel, njit
from nsbench.error_bars.kernels.gram import (
    DAMPING,
    add_multiplied,
    shortest,
    solve_gram,
    times_row,
)
from nsbench.linalg.max_norm import largest
from nsbench.linalg.skyline_cholesky import EnvelopePlan, arrange

PIVOTS = 8  # rounds of block pivoting
OPENS = 10.0 * DAMPING  # of a velocity: a rate at which a contact opens that is more than rounding
PULL = 1e-6  # of own speed: less of a pull at an end of an arc is part of its residual


@inner_kernel
def _solve_some(plan, C, V, count, n, pushes, g, is_refined, q):
    """Fill q (m,) with the solution of N N^T q = g, g (m,), of the rows `pushes` (m,), 0.0 for the
    others."""
    p = 0
    for k in range(len(C)):
        q[k] = 0.0
        p += pushes[k]
    if p == 0:
        return
    if p == len(C):
        solve_gram(plan, C, V, count, n, g, is_refined, q)
        return
    columns = np.empty((p, C.shape[1]), np.int64)
    values = np.empty((p, C.shape[1]))
    length = np.empty(p, np.int64)
    rates = np.empty(p)
    a = 0
    for k in range(len(C)):
        if pushes[k]:
            length[a] = count[k]
            rates[a] = g[k]
            for e in range(count[k]):
                columns[a, e] = C[k, e]
                values[a, e] = V[k, e]
            a += 1
    found = np.empty(p)
    some = arrange(columns, length, p, n)
    solve_gram(some, columns, values, length, n, rates, is_refined, found)
    a = 0
    for k in range(len(C)):
        if pushes[k]:
            q[k] = found[a]
            a += 1


@inner_kernel
def _least_squares(plan, C, V, count, pushes, d, is_refined, q):
    """Fill q (m,) with the multipliers of the rows `pushes` (m,) that make d - N^T q shortest, 0.0
    for the others."""
    g = np.empty(len(C))
    for k in range(len(C)):
        g[k] = times_row(C, V, count, k, d)
    _solve_some(plan, C, V, count, len(d), pushes, g, is_refined, q)


@inner_kernel
def _fill_rest(C, V, count, d, q, rest):
    """Fill rest (n,) with d - N^T q; return the size of d."""
    size = 0.0
    for c in range(len(d)):
        rest[c] = -d[c]
        size += d[c] * d[c]
    add_multiplied(C, V, count, len(C), q, rest)
    for c in range(len(d)):
        rest[c] = -rest[c]
    return np.sqrt(size)


@inner_kernel
def _mark_wrong(C, V, count, pushes, d, q, rest, wrong):
    """Fill rest (n,) with d - N^T q, and wrong (m,): rows with q < 0, and rows that do not push and
    along which the rest opens nothing but closes. Returns how many are wrong."""
    most = OPENS * _fill_rest(C, V, count, d, q, rest)
    found = 0
    for k in range(len(C)):
        is_closing = not pushes[k] and times_row(C, V, count, k, rest) > most
        wrong[k] = is_closing or not q[k] >= 0.0
        found += wrong[k]
    return found


@inner_kernel
def _pivoted(plan, C, V, count, pushes, d, q, rest, wrong):
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
        _least_squares(plan, C, V, count, pushes, d, r > 1, q)
        if _mark_wrong(C, V, count, pushes, d, q, rest, wrong) == 0:
            return True
    return False


@inner_kernel
def _shorten(pushes, q, full):
    """Move q (m,) towards `full` until the first multiplier of the rows `pushes` vanishes, and drop
    that row; returns whether q got to `full`."""
    share = 1.0
    first = -1
    for k in range(len(q)):
        if pushes[k] and full[k] <= 0.0 and q[k] < share * (q[k] - full[k]):
            share = q[k] / (q[k] - full[k])
            first = k
    for k in range(len(q)):
        q[k] += share * (full[k] - q[k])
        if pushes[k] and (k == first or q[k] <= 0.0):
            q[k] = 0.0
            pushes[k] = k != first and full[k] > 0.0
    return first < 0


@inner_kernel
def _one_by_one(plan, C, V, count, pushes, d, q, rest):
    """Fill q (m,) >= 0 such that rest = d - N^T q is shortest, and pushes (m,): the rows with q >
    0.

    Nonnegative least squares, one row after the other (Lawson & Hanson, Solving Least Squares
    Problems, 1974, chapter 23): it cannot cycle.
    """
    m = len(C)
    full = np.empty(m)
    for k in range(m):
        q[k] = 0.0
        pushes[k] = False
    for _ in range(3 * m):
        most = OPENS * _fill_rest(C, V, count, d, q, rest)
        best = -1
        for k in range(m):
            if not pushes[k] and times_row(C, V, count, k, rest) > most:
                most = times_row(C, V, count, k, rest)
                best = k
        if best < 0:
            return
        pushes[best] = True
        for _ in range(m):
            _least_squares(plan, C, V, count, pushes, d, True, full)
            if _shorten(pushes, q, full):
                break
    _fill_rest(C, V, count, d, q, rest)


@inner_kernel
def project_off_cone(
    plan: EnvelopePlan,
    C: np.ndarray,
    V: np.ndarray,
    count: np.ndarray,
    d: np.ndarray,
    pushes: np.ndarray,
    q: np.ndarray,
    rest: np.ndarray,
) -> None:
    """Fill q (m,) >= 0 and rest (n,) such that d = N^T q + rest with the shortest rest; one state.

    plan: of the Gram matrix of the unit gradients C, V (m, w), count (m,); d (n,). pushes (m,): a
    guess of the rows with q > 0, replaced by those that have it; none is no guess.
    """
    if not _pivoted(plan, C, V, count, pushes, d, q, rest, np.empty(len(C), np.bool_)):
        _one_by_one(plan, C, V, count, pushes, d, q, rest)
    for k in range(len(C)):
        pushes[k] = q[k] > 0.0


@njit(cache=True, error_model="numpy")
def split_off_cone(
    C: np.ndarray,
    V: np.ndarray,
    count: np.ndarray,
    d: np.ndarray,
    q: np.ndarray,
    rest: np.ndarray,
) -> None:
    """Fill q (K, m) >= 0 and rest (K, n) such that d = N^T q + rest with the shortest rest.

    d (K, n); unit gradients as in gram_multipliers.
    """
    plan = arrange(C, count, len(C), d.shape[1])
    pushes = np.zeros(len(C), np.bool_)
    for s in range(len(d)):
        pushes[:] = False
        project_off_cone(plan, C, V[s if len(V) > 1 else 0], count, d[s], pushes, q[s], rest[s])


@inner_kernel
def _least_change(plan, C, V, count, rates, f, v, q):
    """Fill v (n,) with what is nearest to f (n,) with N v + rates >= 0, and q (m,) >= 0 with
    v = f + N^T q.

    A least-distance problem: which rows push is found by nonnegative least squares (Lawson &
    Hanson, Solving Least Squares Problems, 1974, chapter 23), of rows with one more entry, what
    they lack at f; their multipliers from their Gram matrix.
    """
    m, w = C.shape
    n = len(f)
    lack = np.empty(m)
    for k in range(m):
        lack[k] = -rates[k] - times_row(C, V, count, k, f)
    unit = max(largest(lack), 1e-300)  # the extended rows are then of length one to two
    columns = np.empty((m, w + 1), np.int64)
    values = np.empty((m, w + 1))
    length = np.empty(m, np.int64)
    for k in range(m):
        for e in range(count[k]):
            columns[k, e] = C[k, e]
            values[k, e] = V[k, e]
        columns[k, count[k]] = n
        values[k, count[k]] = lack[k] / unit
        length[k] = count[k] + 1
    target = np.zeros(n + 1)
    target[n] = 1.0
    pushes = np.zeros(m, np.bool_)
    rest = np.empty(n + 1)
    extended = arrange(columns, length, m, n + 1)
    project_off_cone(extended, columns, values, length, target, pushes, q, rest)
    _solve_some(plan, C, V, count, n, pushes, lack, True, q)
    for k in range(m):
        q[k] = max(q[k], 0.0)
    for i in range(n):
        v[i] = f[i]
    add_multiplied(C, V, count, m, q, v)


@inner_kernel
def constrained_velocity(
    plan: EnvelopePlan,
    C: np.ndarray,
    V: np.ndarray,
    count: np.ndarray,
    rates: np.ndarray,
    f: np.ndarray,
    pushes: np.ndarray,
    v: np.ndarray,
    q: np.ndarray,
) -> None:
    """Fill v (n,) with the projection of the drift f (n,) on the velocities with N v + rates >= 0,
    and q (m,) with the multipliers, v = f + N^T q.

    rates (m,): partial derivatives of the gaps in time. pushes (m,): a guess of the rows with
    q > 0, replaced by those that have it.
    """
    n = len(f)
    base = np.zeros(n)
    size = 0.0
    for c in range(n):
        size += f[c] * f[c]
    if largest(rates) > 0.0:
        shortest(plan, C, V, count, rates, True, base)  # -base keeps all contacts closed
        for k in range(len(C)):
            off = abs(rates[k] - times_row(C, V, count, k, base))
            if off > PULL * max(1.0, np.sqrt(size)):
                # walls that move apart: no v keeps all closed
                _least_change(plan, C, V, count, rates, f, v, q)
                for a in range(len(C)):
                    pushes[a] = q[a] > 0.0
                return
    d = np.empty(n)
    for c in range(n):
        d[c] = -base[c] - f[c]
    project_off_cone(plan, C, V, count, d, pushes, q, v)
    for c in range(n):
        v[c] = -base[c] - v[c]


@inner_kernel
def least_multiplier(
    plan: EnvelopePlan,
    C: np.ndarray,
    V: np.ndarray,
    count: np.ndarray,
    rates: np.ndarray,
    f: np.ndarray,
) -> float:
    """Return the least of the multipliers with which the drift f (n,) keeps all contacts closed."""
    pull = np.empty(len(C))
    q = np.empty(len(C))
    for k in range(len(C)):
        pull[k] = -times_row(C, V, count, k, f) - rates[k]
    solve_gram(plan, C, V, count, len(f), pull, False, q)
    return q.min()


@inner_kernel
def tangential_rest(
    plan: EnvelopePlan,
    C: np.ndarray,
    V: np.ndarray,
    count: np.ndarray,
    rates: np.ndarray,
    v: np.ndarray,
    rest: np.ndarray,
    q: np.ndarray,
) -> None:
    """Split the residual v - f of a velocity v (n,) into N^T q, q (m,) >= 0, and a rest.

    rest (n,): in, v - f; out, what no multipliers make. The normal velocity counts as that of the
    face, whatever it is: rates (m,) are the partial derivatives of the gaps in time.
    """
    n = len(v)
    lack = np.empty(len(C))
    for k in range(len(C)):
        lack[k] = times_row(C, V, count, k, v) + rates[k]
    d = np.empty(n)
    shortest(plan, C, V, count, lack, True, d)
    for c in range(n):
        d[c] = rest[c] - d[c]
    project_off_cone(plan, C, V, count, d, np.zeros(len(C), np.bool_), q, rest)
