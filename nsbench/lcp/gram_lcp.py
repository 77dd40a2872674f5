"""Active-set method for complementarity problems with a Gram matrix M = G G^T, G of any rank.

    0 <= lam _|_ w = h + M lam >= 0

Lawson & Hanson's method for non-negative least squares in Gram form (Solving Least Squares
Problems, 1974, chapter 23), with the treatment of dependent rows of Goldfarb & Idnani (Mathematical
Programming 27, 1983): the rows with lam > 0 stay linearly independent, so a basic solution is
returned even where lam is not unique. Codes with principal pivots for general M fail on such
rank-deficient sets of contacts. The support idx[:p] has the Cholesky factor L of its rows of M.
"""

import numpy as np

from nsbench.compilation.decorators import inner_kernel, njit

OK = 0
INFEASIBLE = 1
UNFINISHED = 2
# coefficients of a null direction below this are rounding: eps over the smallest squared sine
NULL_COEFFICIENT = 1e-6
# iterations: a fixed number, and so many per row
LEAST_ITERATIONS = 50
ITERATIONS_PER_ROW = 20
# of a row that depends on others: eps over the smallest sine that counts as independent (1e-5)
ROUNDING = 1e-9


@inner_kernel
def _append(L, M, idx, p, k, dep):
    """Append index k to the support and its row to the factor; False if it depends on the rows of
    idx[:p] (squared sine at most dep). Fills L[p, :p] in any case."""
    pivot = M[k, k]
    for a in range(p):
        s = M[k, idx[a]]
        for b in range(a):
            s -= L[p, b] * L[a, b]
        L[p, a] = s / L[a, a]
        pivot -= L[p, a] * L[p, a]
    if not pivot > dep * M[k, k]:
        return False
    L[p, p] = np.sqrt(pivot)
    idx[p] = k
    return True


@inner_kernel
def _remove(L, M, idx, p, place, dep):
    """Remove idx[place] and factor the later rows again; returns the new p."""
    q = place
    for a in range(place + 1, p):
        if _append(L, M, idx, q, idx[a], dep):
            q += 1
    return q


@inner_kernel
def _backsolve(L, p, v):
    """Replace v by L^-T v for the leading p rows."""
    for a in range(p - 1, -1, -1):
        for b in range(a + 1, p):
            v[a] -= L[b, a] * v[b]
        v[a] /= L[a, a]


@inner_kernel
def _solve(L, p, v):
    """Replace v by (L L^T)^-1 v for the leading p rows."""
    for a in range(p):
        for b in range(a):
            v[a] -= L[a, b] * v[b]
        v[a] /= L[a, a]
    _backsolve(L, p, v)


@inner_kernel
def _target(L, M, h, idx, p):
    """Return lam (p,) on idx[:p] with w = 0 there, refined once."""
    s = np.empty(p)
    for a in range(p):
        s[a] = -h[idx[a]]
    _solve(L, p, s)
    r = np.empty(p)
    for a in range(p):
        r[a] = -h[idx[a]]
        for b in range(p):
            r[a] -= M[idx[a], idx[b]] * s[b]
    _solve(L, p, r)
    for a in range(p):
        s[a] += r[a]
    return s


@inner_kernel
def _settle(L, M, h, idx, p, lam, dep):
    """Move lam to the target of its support, dropping what becomes zero on the way (Lawson &
    Hanson's inner loop); returns p."""
    while p > 0:
        s = _target(L, M, h, idx, p)
        alpha = 1.0
        worst = np.int64(-1)
        for a in range(p):
            if s[a] <= 0.0:
                old = lam[idx[a]]
                step = old / (old - s[a]) if old > 0.0 else 0.0
                if step < alpha or worst < 0:
                    alpha = step
                    worst = a
        for a in range(p):
            lam[idx[a]] += alpha * (s[a] - lam[idx[a]])
        if worst < 0:
            for a in range(p):
                lam[idx[a]] = s[a]
            break
        lam[idx[worst]] = 0.0
        p = _remove(L, M, idx, p, worst, dep)
    return p


@inner_kernel
def _exchange(L, M, idx, p, k, lam, dep):
    """Exchange k, which depends on the support: move along the null direction with lam_k growing
    until a member vanishes.

    Returns the new p with k in the support, or -1 if nothing blocks: no velocity satisfies row k
    and these rows.
    """
    c = np.empty(p)
    for a in range(p):
        c[a] = L[p, a]
    _backsolve(L, p, c)  # G_k = sum_a c_a G_a
    block = np.int64(-1)
    alpha = np.inf
    for a in range(p):
        if c[a] > NULL_COEFFICIENT and lam[idx[a]] / c[a] < alpha:
            block = a
            alpha = lam[idx[a]] / c[a]
    if block < 0:
        return -1
    for a in range(p):
        lam[idx[a]] = max(0.0, lam[idx[a]] - alpha * c[a])
    lam[idx[block]] = 0.0
    lam[k] = alpha
    p = _remove(L, M, idx, p, block, dep)
    return p + 1 if _append(L, M, idx, p, k, dep) else p


@inner_kernel
def _fill_slacks(M, h, lam, w):
    """Fill w (m,) with h + M lam."""
    for k in range(h.size):
        w[k] = h[k]
        for a in range(h.size):
            w[k] += M[k, a] * lam[a]


@inner_kernel
def _term_size(M, h, lam, k):
    """Return the size of the terms that w_k is the sum of."""
    s = abs(h[k])
    for a in range(h.size):
        s += abs(M[k, a]) * lam[a]
    return s


@inner_kernel
def _drop_negative(L, M, h, idx, p, lam, dep):
    """Set lam to the target of the support without the members where it is negative, dropped one by
    one; returns the new p."""
    while p > 0:
        s = _target(L, M, h, idx, p)
        worst = np.int64(0)
        for a in range(1, p):
            if s[a] < s[worst] or s[a] != s[a]:
                worst = a
        if s[worst] > 0.0:
            for a in range(p):
                lam[idx[a]] = s[a]
            break
        p = _remove(L, M, idx, p, worst, dep)
    return p


@inner_kernel
def _most_violated(M, lam, w, skip, tol):
    """Return the row violated most, as a length; -1 for none. skip (m,): rows left out."""
    k = np.int64(-1)
    worst = 0.0
    for c in range(lam.size):
        if lam[c] == 0.0 and not skip[c] and w[c] < -tol[c]:
            size = w[c] / np.sqrt(M[c, c]) if M[c, c] > 0.0 else -np.inf
            if size < worst:
                k = c
                worst = size
    return k


@inner_kernel
def _violated_row(M, h, lam, w, tol):
    """Return the last row with w_k below zero by more than tol and rounding; -1 for none."""
    bad = -1
    for k in range(h.size):
        if w[k] < -max(tol[k], ROUNDING * _term_size(M, h, lam, k)):
            bad = k
    return bad


@njit(cache=True, error_model="numpy")
def solve_lcp(M: np.ndarray, h: np.ndarray, warm: np.ndarray, tol: np.ndarray, dep: float) -> tuple:
    """Compute a basic solution of 0 <= lam _|_ h + M lam >= 0.

    M (m, m) = G G^T; h (m,); warm: indices to try as the support first; tol (m,): how negative w
    may stay;
    dep: rows whose squared sine against the support is at most this count as dependent.
    Returns lam (m,), w (m,), support (p,), code (OK, INFEASIBLE, UNFINISHED), row that cannot be
    satisfied or -1, iterations.
    """
    m = h.size
    lam = np.zeros(m)
    skip = np.zeros(m, np.bool_)
    L = np.zeros((m + 1, m + 1))
    idx = np.empty(m + 1, np.int64)
    p = np.int64(0)
    for k in warm:
        if M[k, k] > 0.0 and _append(L, M, idx, p, k, dep):
            p += 1
    p = _drop_negative(L, M, h, idx, p, lam, dep)
    code = UNFINISHED
    bad = -1
    it = 0
    w = np.empty(m)
    _fill_slacks(M, h, lam, w)
    # Lawson & Hanson's outer loop: the row violated most joins the support
    while it < LEAST_ITERATIONS + ITERATIONS_PER_ROW * m:
        it += 1
        k = _most_violated(M, lam, w, skip, tol)
        if k < 0:
            code = OK
            break
        if M[k, k] == 0.0:
            code = INFEASIBLE
            bad = k
            break
        if _append(L, M, idx, p, k, dep):
            p += 1
        else:
            q = _exchange(L, M, idx, p, k, lam, dep)
            if q < 0 and w[k] > -ROUNDING * _term_size(M, h, lam, k):
                skip[k] = True  # w_k follows from the support, where w = 0: it is rounding
                continue
            if q < 0:
                code = INFEASIBLE
                bad = k
                p = 0
                break
            p = q
        p = _settle(L, M, h, idx, p, lam, dep)
        _fill_slacks(M, h, lam, w)
        if lam[k] > 0.0:
            skip[:] = False
        else:
            skip[k] = True  # rounding: it is zero from either side
    if code != INFEASIBLE:
        bad = _violated_row(M, h, lam, w, tol)
        code = OK if bad < 0 else UNFINISHED
    return lam, w, idx[:p].copy(), code, bad, it


@njit(cache=True, error_model="numpy")
def in_span(M: np.ndarray, support: np.ndarray, dep: float) -> np.ndarray:
    """Return (m,) for each row whether it lies in the span of the independent rows `support`:
    squared sine at most dep."""
    m = M.shape[0]
    L = np.zeros((m + 1, m + 1))
    idx = np.empty(m + 1, np.int64)
    p = np.int64(0)
    for k in support:
        if _append(L, M, idx, p, k, 0.0):
            p += 1
    out = np.zeros(m, np.bool_)
    for k in support:
        out[k] = True
    for k in range(m):
        out[k] = out[k] or not _append(L, M, idx, p, k, dep)
    return out
