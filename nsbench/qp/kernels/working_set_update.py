"""The active set of a step, revised row by row on one sparse factor.

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

import numpy as np

from nsbench.compilation.decorators import njit
from nsbench.linalg.dense import solve_gauss
from nsbench.linalg.multifrontal import backward, factor, forward, solve
from nsbench.linalg.sparse_ldl import push, slack

# the proximal term, what it is multiplied by when centres move slowly, its end
RHO = 1e6
MORE = 100.0
MOST = 1e8
# centres in all; after so many the proximal term is made smaller
CENTRES = 12
SLOW = 4
EXTRA = 64  # columns kept; a fresh factor costs about ten of them
FINE = 1e-3  # of the residual asked for: no need to go on
ZERO = 1e-12  # a multiplier, a length, this little below zero is rounding


@njit(cache=True, error_model="numpy")
def _column(T, L, k, owner, ptr, vals, y, z, v):
    """v = K^-1 g_k: forwards only along the fronts above the row."""
    order = T[0]
    first = T[1]
    up = T[2]
    bptr = T[3]
    loc = T[9]
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


@njit(cache=True, error_model="numpy")
def _dot(ptr, cols, vals, k, v):
    s = 0.0
    for e in range(ptr[k], ptr[k + 1]):
        s += vals[e] * v[cols[e]]
    return s


@njit(cache=True, error_model="numpy")
def _point(P, vals, rho, on, extra, size, V, S, A, b, base, c, wc, move, t):
    """The solution on the set: move = d - d_c (n,), t = c - rho w (m,)."""
    ptr = P[0]
    cols = P[1]
    for i in range(size):
        for j in range(size):
            A[i, j] = S[i, j]
        A[i, i] += 1.0 / rho if on[extra[i]] else -1.0 / rho
        b[i] = -_dot(ptr, cols, vals, extra[i], base)
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
        t[k] = c[k] - rho * (wc[k] + _dot(ptr, cols, vals, k, move))


@njit(cache=True, error_model="numpy")
def _centre(P, T, room, vals, rho, on, c, wc, base, r):
    """base: the way from the centre c, where w is wc, to the solution on the set if nothing was
    exchanged since."""
    for k in range(c.size):
        r[k] = -rho * wc[k] if on[k] else -c[k]
    push(P, vals, r, base)
    solve(T, room[0], base, base, room[3])


@njit(cache=True, error_model="numpy")
def _factor(P, T, room, vals, rho, on, weight):
    for k in range(on.size):
        weight[k] = rho if on[k] else 0.0
    factor(T, P[0], vals, weight, room[0], room[1], room[2])


@njit(cache=True, error_model="numpy")
def _block(on, mu, t):
    """The row whose multiplier reaches zero first on the way from mu to t, or -1, and how far that
    is."""
    part = 1.0
    at = -1
    for k in range(mu.size):
        if on[k] and t[k] < -ZERO and mu[k] <= part * (mu[k] - t[k]):
            part = mu[k] / (mu[k] - t[k])
            at = k
    return part, at


@njit(cache=True, error_model="numpy")
def _wrong(on, t):
    count = 0
    for k in range(on.size):
        count += (on[k] and t[k] < -ZERO) or (not on[k] and t[k] > ZERO)
    return count


@njit(cache=True, error_model="numpy")
def _move(on, mu, t, worst):
    """mu goes towards t until a row leaves: that row, or, where all of the way is gone, the row
    violated by most, beyond `worst`; -1 if there is none."""
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


@njit(cache=True, error_model="numpy")
def _residual(P, vals, q, mu, d, w):
    """Fill d = G^T mu and w = q + G d; the largest |min(mu, w)|."""
    push(P, vals, mu, d)
    slack(P, vals, q, d, w)
    off = 0.0
    for k in range(mu.size):
        off = max(off, abs(min(mu[k], w[k])))
    return off


@njit(cache=True, error_model="numpy")
def _swap(P, T, room, vals, rho, owner, c, wc, on, at, extra, size, V, S, base):
    """Row `at` joins or leaves the set: a column and a line more, or, where it only comes back,
    less. The new size; -1 without room for it, and then nothing has changed."""
    place = 0
    while place < size and extra[place] != at:
        place += 1
    if place == EXTRA:
        return -1
    n = base.size
    v = V[place]
    if place == size:
        _column(T, room[0], at, owner[at], P[0], vals, room[3][:n], room[3][n:], v)
    f = rho * wc[at] - c[at] if not on[at] else c[at] - rho * wc[at]
    for e in range(n):
        base[e] -= f * v[e]
    on[at] = not on[at]
    if place == size:
        extra[size] = at
        size = size + 1
        for i in range(size):
            S[i, size - 1] = S[size - 1, i] = _dot(P[0], P[1], vals, extra[i], v)
        return size
    size -= 1  # back where it was: the last column takes its place
    for e in range(n):
        v[e] = V[size, e]
    extra[place] = extra[size]
    for i in range(size):
        S[place, i] = S[size, i] if i != place else S[size, size]
    for i in range(size):
        S[i, place] = S[place, i]
    return size


@njit(cache=True)
def _owners(T, m):
    """The front of each row."""
    owner = np.empty(m, np.int64)
    for s in range(T[7].size - 1):
        for o in range(T[7][s], T[7][s + 1]):
            owner[T[8][o]] = s
    return owner


@njit(cache=True, error_model="numpy")
def update_working_set(P, T, room, vals, q, mu, tol, most, limit, d, w):
    """From mu >= 0 (m,) to the solution: fills mu, d = G^T mu (n,), w = q + G d (m,).

    vals, q: rows of length 1; T, room: see kernels.interior. Gives up if more than `most` signs are
    wrong at first or after `limit` exchanges; mu is then no worse than before. Returns whether it
    is solved to the residual tol, factorisations, exchanges.
    """
    m = mu.size
    n = d.size
    on = np.empty(m, np.bool_)
    c = mu.copy()
    wc = np.empty(m)
    t = np.empty(m)
    r = np.empty(m)
    best = np.empty(m)
    for k in range(m):
        on[k] = mu[k] > 0.0
    owner = _owners(T, m)
    extra = np.empty(EXTRA, np.int64)
    V = np.empty((EXTRA, n))
    S = np.empty((EXTRA, EXTRA))
    A = np.empty((EXTRA, EXTRA))
    b = np.empty(EXTRA)
    # no literal: kernels are compiled for numbers
    base = np.empty(n)
    move = np.empty(n)
    size = np.int64(0)
    rho = RHO
    factors = 1
    swaps = 0
    centres = 0
    found = False
    _factor(P, T, room, vals, rho, on, t)
    push(P, vals, c, base)
    slack(P, vals, q, base, wc)
    _centre(P, T, room, vals, rho, on, c, wc, base, r)
    while True:
        _point(P, vals, rho, on, extra, size, V, S, A, b, base, c, wc, move, t)
        if swaps + centres == 0 and factors == 1 and not _wrong(on, t) <= most:
            return False, factors, swaps
        at = _move(on, mu, t, 0.5 * tol * rho)
        if at < 0:  # solved on this centre
            off = _residual(P, vals, q, mu, d, w)
            if off <= FINE * tol or (off <= tol and found):
                return True, factors, swaps
            centres += 1
            if not off < np.inf or centres > CENTRES:
                break
            if off <= tol:  # once more, for one solve: hundreds of times closer
                found = True
                for k in range(m):
                    best[k] = mu[k]
            for k in range(m):
                c[k] = mu[k]
                wc[k] = w[k]
            if centres >= SLOW and rho < MOST and not found:
                rho = rho * MORE
                centres = 0
                size = 0
                factors = factors + 1
                _factor(P, T, room, vals, rho, on, t)
            _centre(P, T, room, vals, rho, on, c, wc, base, r)
            continue
        if swaps == limit:
            break
        swaps += 1
        size = _swap(P, T, room, vals, rho, owner, c, wc, on, at, extra, size, V, S, base)
        if size < 0:  # a factor of the set as it will be
            on[at] = not on[at]
            size = 0
            factors = factors + 1
            _factor(P, T, room, vals, rho, on, t)
            _centre(P, T, room, vals, rho, on, c, wc, base, r)
    if found:
        for k in range(m):
            mu[k] = best[k]
        _residual(P, vals, q, mu, d, w)
    return found, factors, swaps
