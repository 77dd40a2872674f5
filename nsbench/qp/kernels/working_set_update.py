"""Update of the working set of a projection QP, row by row, on one multifrontal factor.

    min 1/2 |G^T mu|^2 + q mu + |mu - c|^2 / (2 rho)    s.t.  mu >= 0            rows of G of length
    1

is the dual of the step's problem with a proximal term, which keeps the solution on every set of
rows unique, redundant rows or not (Rockafellar, SIAM J. Control Optim. 14(5), 1976). A primal
active set solves it: K = I + rho G_A^T G_A is factored for the rows A of the start; each row that
leaves (its multiplier reaches zero) or comes (it is violated most) costs one column K^-1 g and a
line of a small dense system (Gill, Murray & Saunders, SIAM J. Sci. Comput. 5(3), 1984: Schur
complements). The value falls from full step to full step, so no set comes back. Then c = mu, until
the residual of the step's own problem is small; if that takes long, on a factor with a larger rho.
Everything is computed as a change from c, so rounding shrinks with it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nsbench.compilation.decorators import inner_kernel
from nsbench.linalg.gauss_elimination import solve_gauss
from nsbench.linalg.multifrontal import backward, factor, forward, solve
from nsbench.linalg.sparse_ldl import push, slack

# the proximal term rho, what it is multiplied by when centres move slowly, its largest value
RHO = 1e6
RHO_FACTOR = 100.0
LARGEST_RHO = 1e8
# centres in all; after so many the proximal term is weakened
MAX_CENTRES = 12
SLOW_CENTRES = 4
EXTRA = 64  # columns stored; a fresh factor costs about ten of them
FINE = 1e-3  # of the residual asked for: no need to go on
ZERO = 1e-12  # a multiplier, a length, this little below zero is rounding


class Exchanges(NamedTuple):
    """Rows exchanged since the factor, in the order of their columns. rows (EXTRA,); V (EXTRA, n):
    K^-1 g of each; S (EXTRA, EXTRA): their products with the rows; A, b: the Schur complement and
    its right-hand side."""

    rows: np.ndarray
    V: np.ndarray
    S: np.ndarray
    A: np.ndarray
    b: np.ndarray


class Centre(NamedTuple):
    """The centre c (m,) of the proximal term, w there, wc (m,), and base (n,): the displacement
    from it to the solution on the set if nothing had been exchanged since the factor, corrected by
    the rows exchanged."""

    c: np.ndarray
    wc: np.ndarray
    base: np.ndarray


class SetWork(NamedTuple):
    """Work arrays. t (m,): c - rho w, the multipliers on a set; r (m,); move (n,): d - d_c."""

    t: np.ndarray
    r: np.ndarray
    move: np.ndarray


@inner_kernel
def _column(T, L, k, owner, ptr, vals, y, z, v):
    """Fill v (n,) with K^-1 g_k: forwards only along the fronts above the row; owner: its front."""
    order = T.order
    first = T.first
    up = T.up
    bptr = T.bptr
    loc = T.loc
    for c in range(y.size):
        y[c] = 0.0
    s = owner
    own = first[s + 1] - first[s]
    for i in range(own + bptr[s + 1] - bptr[s]):
        z[i] = 0.0
    for e in range(ptr[k], ptr[k + 1]):
        z[loc[e]] += vals[e]
    while True:
        forward(T, L, s, y, z)
        s = up[s]
        if s < 0:
            break
        own = first[s + 1] - first[s]
        for i in range(own):
            z[i] = y[first[s] + i]
        for i in range(bptr[s + 1] - bptr[s]):
            z[own + i] = 0.0
    backward(T, L, y, z)
    for c in range(y.size):
        v[order[c]] = y[c]


@inner_kernel
def _row_times(ptr, cols, vals, k, v):
    """Return g_k . v."""
    s = 0.0
    for e in range(ptr[k], ptr[k + 1]):
        s += vals[e] * v[cols[e]]
    return s


@inner_kernel
def _solve_on_set(P, vals, rho, on, exchanges, size, centre, move, t):
    """Solve on the set with `size` rows exchanged: move = d - d_c (n,), t = c - rho w (m,)."""
    extra, V, S, A, b = exchanges
    c, wc, base = centre
    ptr = P.ptr
    cols = P.cols
    for i in range(size):
        for j in range(size):
            A[i, j] = S[i, j]
        A[i, i] += 1.0 / rho if on[extra[i]] else -1.0 / rho
        b[i] = -_row_times(ptr, cols, vals, extra[i], base)
    if not solve_gauss(A[:size, :size], b[:size]):
        b[:size] = np.nan  # dependent rows: the residual will say so
    for e in range(move.size):
        move[e] = base[e]
    for i in range(size):
        f = b[i]
        v = V[i]
        for e in range(move.size):
            move[e] += f * v[e]
    for k in range(t.size):
        t[k] = c[k] - rho * (wc[k] + _row_times(ptr, cols, vals, k, move))


@inner_kernel
def _solve_at_centre(P, T, room, vals, rho, on, centre, r):
    """Fill centre.base for the set of the factor; r (m,): work."""
    c, wc, base = centre
    for k in range(c.size):
        r[k] = -rho * wc[k] if on[k] else -c[k]
    push(P, vals, r, base)
    solve(T, room.L, base, base, room.work)


@inner_kernel
def _factor_set(P, T, room, vals, rho, on, weight):
    """Factor K = I + rho G_A^T G_A for the set; weight (m,): work."""
    for k in range(on.size):
        weight[k] = rho if on[k] else 0.0
    factor(T, P.ptr, vals, weight, room.L, room.F, room.stack)


@inner_kernel
def _block(on, mu, t):
    """Return how far mu can go towards t, and the row whose multiplier reaches zero first, or
    -1."""
    part = 1.0
    at = -1
    for k in range(mu.size):
        if on[k] and t[k] < -ZERO and mu[k] <= part * (mu[k] - t[k]):
            part = mu[k] / (mu[k] - t[k])
            at = k
    return part, at


@inner_kernel
def _count_wrong_signs(on, t):
    count = 0
    for k in range(on.size):
        count += (on[k] and t[k] < -ZERO) or (not on[k] and t[k] > ZERO)
    return count


@inner_kernel
def _move_towards(on, mu, t, worst):
    """Move mu towards t until a row leaves; returns that row, or, at t, the row violated by most,
    beyond `worst`; -1 if there is none."""
    part, at = _block(on, mu, t)
    for k in range(mu.size):
        if on[k]:
            mu[k] = max(mu[k] + part * (t[k] - mu[k]), 0.0)
    if at >= 0:
        mu[at] = 0.0
        return at
    for k in range(mu.size):
        if not on[k] and t[k] > worst:
            worst = t[k]
            at = k
    return at


@inner_kernel
def _residual(P, vals, q, mu, d, w):
    """Fill d = G^T mu and w = q + G d; returns the largest |min(mu, w)|."""
    push(P, vals, mu, d)
    slack(P, vals, q, d, w)
    off = 0.0
    for k in range(mu.size):
        off = max(off, abs(min(mu[k], w[k])))
    return off


@inner_kernel
def _exchange_row(P, T, room, vals, rho, owner, centre, on, at, exchanges, size):
    """Let row `at` join or leave the set: one column more, or, where it only returns, one less.
    Returns the new number of columns; -1 without room for it, and then nothing has changed."""
    extra, V, S, _, _ = exchanges
    c, wc, base = centre
    place = 0
    while place < size and extra[place] != at:
        place += 1
    if place == EXTRA:
        return -1
    n = base.size
    v = V[place]
    if place == size:
        _column(T, room.L, at, owner[at], P.ptr, vals, room.work[:n], room.work[n:], v)
    f = rho * wc[at] - c[at] if not on[at] else c[at] - rho * wc[at]
    for e in range(n):
        base[e] -= f * v[e]
    on[at] = not on[at]
    if place == size:
        extra[size] = at
        size = size + 1
        for i in range(size):
            S[i, size - 1] = S[size - 1, i] = _row_times(P.ptr, P.cols, vals, extra[i], v)
        return size
    size -= 1  # it returns: the last column takes its place
    for e in range(n):
        v[e] = V[size, e]
    extra[place] = extra[size]
    for i in range(size):
        S[place, i] = S[size, i] if i != place else S[size, size]
    for i in range(size):
        S[i, place] = S[place, i]
    return size


@inner_kernel
def _owners(T, m):
    """Return the front of each row."""
    owner = np.empty(m, np.int64)
    for s in range(T.optr.size - 1):
        for o in range(T.optr[s], T.optr[s + 1]):
            owner[T.orow[o]] = s
    return owner


@inner_kernel
def _no_exchanges(n):
    """Return the Exchanges with room for EXTRA rows, none of them filled."""
    return Exchanges(
        np.empty(EXTRA, np.int64),
        np.empty((EXTRA, n)),
        np.empty((EXTRA, EXTRA)),
        np.empty((EXTRA, EXTRA)),
        np.empty(EXTRA),
    )


@inner_kernel
def _solve_on_centre(
    P, T, room, vals, rho, owner, centre, on, mu, exchanges, steps, work, least, most, limit
):
    """Solve the proximal problem of one centre by a primal active set, from mu >= 0 (m,).

    owner (m,): front of each row; steps: columns in use, factorisations and exchanges so far;
    work: SetWork; least: violation from which a row joins; most: wrong signs allowed at first, -1:
    any number. Returns whether it is solved (not where more signs are wrong, or after `limit`
    exchanges), and the three numbers of steps.
    """
    size, factors, swaps = steps
    t, r, move = work
    while True:
        _solve_on_set(P, vals, rho, on, exchanges, size, centre, move, t)
        if most >= 0 and not _count_wrong_signs(on, t) <= most:
            return False, size, factors, swaps
        most = np.int64(-1)
        at = _move_towards(on, mu, t, least)
        if at < 0 or swaps == limit:
            return at < 0, size, factors, swaps
        swaps += 1
        size = _exchange_row(P, T, room, vals, rho, owner, centre, on, at, exchanges, size)
        if size < 0:  # a factor of the set as it will be
            on[at] = not on[at]
            size = 0
            factors = factors + 1
            _factor_set(P, T, room, vals, rho, on, t)
            _solve_at_centre(P, T, room, vals, rho, on, centre, r)


@inner_kernel
def update_working_set(P, T, room, vals, q, mu, tol, most, limit, d, w) -> tuple[bool, int, int]:
    """Move mu >= 0 (m,) to the solution of the projection QP: fills mu, d = G^T mu (n,), w = q + G
    d (m,).

    vals, q: rows of length 1; P, T, room: see interior_point. Gives up if more than `most` signs
    are wrong at first or after `limit` exchanges; mu is then no worse than before. Returns whether
    it is solved to the residual tol, factorisations, exchanges.
    """
    m = mu.size
    n = d.size
    on = np.empty(m, np.bool_)
    centre = Centre(mu.copy(), np.empty(m), np.empty(n))
    exchanges = _no_exchanges(n)
    t = np.empty(m)
    r = np.empty(m)
    best = np.empty(m)
    work = SetWork(t, r, np.empty(n))
    for k in range(m):
        on[k] = mu[k] > 0.0
    owner = _owners(T, m)
    steps = np.int64(0), np.int64(1), np.int64(0)  # no literals: kernels are compiled for numbers
    rho = RHO
    centres = 0
    found = False
    _factor_set(P, T, room, vals, rho, on, t)
    push(P, vals, centre.c, centre.base)
    slack(P, vals, q, centre.base, centre.wc)
    _solve_at_centre(P, T, room, vals, rho, on, centre, r)
    # proximal-point method: the solution of the problem on one centre is the next centre
    while True:
        least = 0.5 * tol * rho
        solved, size, factors, swaps = _solve_on_centre(
            P, T, room, vals, rho, owner, centre, on, mu, exchanges, steps, work, least, most, limit
        )
        most = np.int64(-1)
        if not solved:
            break
        off = _residual(P, vals, q, mu, d, w)
        if off <= FINE * tol or (off <= tol and found):
            return True, factors, swaps
        centres += 1
        if not off < np.inf or centres > MAX_CENTRES:
            break
        if off <= tol:  # once more, for one solve: hundreds of times closer
            found = True
            _copy(mu, best)
        _copy(mu, centre.c)
        _copy(w, centre.wc)
        if centres >= SLOW_CENTRES and rho < LARGEST_RHO and not found:
            rho = rho * RHO_FACTOR
            centres = 0
            size = np.int64(0)
            factors = factors + 1
            _factor_set(P, T, room, vals, rho, on, t)
        _solve_at_centre(P, T, room, vals, rho, on, centre, r)
        steps = size, factors, swaps
    if found:
        _copy(best, mu)
        _residual(P, vals, q, mu, d, w)
    return found, factors, swaps


@inner_kernel
def _copy(source, target):
    """Copy an array; a loop, as numba takes long to compile an assignment of arrays."""
    for k in range(target.size):
        target[k] = source[k]
