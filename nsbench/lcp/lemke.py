"""Lemke's method for complementarity problems with a general square matrix, regular or not.

    0 <= lam _|_ w = r + M lam >= 0

First the support of the last solution, then Lemke's method with lexicographic pivots (Cottle, Pang
& Stone, The Linear Complementarity Problem, 1992, section 4.4), then all supports if there are few.
Rows and columns are scaled first:
circuits mix ohms with 1e-6 farads. Of several solutions with the same w the least-norm one can be
computed (Han, Tiwari, Camlibel & Pang, SIAM J. Numer. Anal. 47(5), 2009): `least_norm_solution`.
Loops stand where numpy would add rows: its broadcasting takes numba seconds to compile.
"""

import numpy as np

from nsbench.compilation.decorators import inner_kernel, njit
from nsbench.lcp.gram_lcp import solve_lcp
from nsbench.linalg.gauss_elimination import solve_gauss
from nsbench.linalg.rank import near_singular, orthonormal

ENUMERATED_ROWS = 10  # rows whose 2^m supports are tried when Lemke's method ends on a ray
SIGN = 1e-12  # of the terms of a sum: below, its sign is rounding (a few hundred operations)
PIVOT = 1e-11  # of scaled entries: below, they are no pivots
SCALINGS = 8  # rounds of row and column scaling
MOTION = 1e-9  # relative difference below which two motions are one
RANK = 1e-10  # relative singular value of scaled rows below which they count as dependent


@njit(cache=True, error_model="numpy")
def scales(M: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return factors of rows (m,) and columns (m,) that bring the entries of M (m, m) near one."""
    m = M.shape[0]
    a = np.ones(m)
    b = np.ones(m)
    # Alternate scaling of rows and columns by the square root of their largest entry.
    for _ in range(SCALINGS):
        for i in range(m):
            s = 0.0
            for j in range(m):
                s = max(s, abs(M[i, j]) * a[i] * b[j])
            if s > 0.0:
                a[i] /= np.sqrt(s)
        for j in range(m):
            s = 0.0
            for i in range(m):
                s = max(s, abs(M[i, j]) * a[i] * b[j])
            if s > 0.0:
                b[j] /= np.sqrt(s)
    return a, b


@inner_kernel
def slack(M: np.ndarray, r: np.ndarray, lam: np.ndarray, w: np.ndarray) -> bool:
    """Fill w (m,) with r + M lam, M (m, m), r, lam (m,).

    Returns whether lam and w are non-negative and complementary up to rounding.
    """
    m = r.size
    top = 0.0
    good = True
    for i in range(m):
        top = max(top, abs(lam[i]))
    for i in range(m):
        w[i] = r[i]
        size = abs(r[i])
        for j in range(m):
            w[i] += M[i, j] * lam[j]
            size += abs(M[i, j] * lam[j])
        if (
            not w[i] >= -SIGN * size
            or not lam[i] >= -SIGN * top
            or (lam[i] != 0.0 and not w[i] <= SIGN * size)
        ):
            good = False
    return good


@inner_kernel
def by_support(
    M: np.ndarray, r: np.ndarray, on: np.ndarray, lam: np.ndarray, w: np.ndarray
) -> bool:
    """Fill lam with the solution of w = 0 on the support `on`, zero elsewhere.

    M (m, m); r, on, lam, w (m,); w is filled too. Returns False if there is no such lam or it does
    not solve the problem.
    """
    m = r.size
    idx = np.flatnonzero(on)
    p = idx.size
    for i in range(m):
        lam[i] = 0.0
    # Principal submatrix of the support.
    if p:
        N = np.empty((p, p))
        b = np.empty(p)
        for i in range(p):
            b[i] = -r[idx[i]]
            for j in range(p):
                N[i, j] = M[idx[i], idx[j]]
        if not solve_gauss(N.copy(), b):
            return False
        for i in range(p):
            lam[idx[i]] = b[i]
        for i in range(p):  # one refinement
            b[i] = -r[idx[i]]
            for j in range(m):
                b[i] -= M[idx[i], j] * lam[j]
        if solve_gauss(N, b):
            for i in range(p):
                lam[idx[i]] += b[i]
    if not slack(M, r, lam, w):
        return False
    for i in range(m):
        lam[i] = max(lam[i], 0.0)
    return True


@inner_kernel
def _leaving(T, col, basis, m, z0):
    """Return the row that leaves for column `col` by the lexicographic ratio test, -1 on a ray; the
    artificial variable z0 goes first."""
    best = -1
    last = T.shape[1] - 1
    for i in range(m):
        if not T[i, col] > PIVOT:
            continue
        if best < 0:
            best = i
            continue
        for k in range(m + 1):  # right-hand side first, then the columns of the inverse
            c = last if k == 0 else k - 1
            a = T[i, c] / T[i, col]
            b = T[best, c] / T[best, col]
            close = abs(a - b) <= 1e-13 * (abs(a) + abs(b))
            if close and k == 0 and (basis[i] == z0 or basis[best] == z0):
                best = i if basis[i] == z0 else best
                break
            if not close:
                if a < b:
                    best = i
                break
    return best


@inner_kernel
def lemke(M: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, bool, int]:
    """Solve scaled data by Lemke's complementary pivots with the covering vector of ones.

    M (m, m), r (m,). Returns support (m,), whether it was found, pivots.
    """
    m = r.size
    # the tableau of w - M lam - z0 = r
    T = np.zeros((m, 2 * m + 2))  # w | lam | z0 | right-hand side
    basis = np.arange(m)
    z0 = 2 * m
    for i in range(m):
        T[i, i] = 1.0
        T[i, z0] = -1.0
        T[i, z0 + 1] = r[i]
        for j in range(m):
            T[i, m + j] = -M[i, j]
    on = np.zeros(m, np.bool_)
    row = np.argmin(r)
    if r[row] >= 0.0:
        return on, True, 0
    enter = z0
    limit = 100 + 20 * m
    # Lemke's method: pivot, then let the complement of the leaving variable enter
    for it in range(limit):
        p = T[row, enter]
        for j in range(2 * m + 2):
            T[row, j] /= p
        for i in range(m):
            p = T[i, enter]
            if i != row and p != 0.0:
                for j in range(2 * m + 2):
                    T[i, j] -= p * T[row, j]
        out = basis[row]
        basis[row] = enter
        if out == z0:
            for i in range(m):
                if basis[i] >= m:
                    on[basis[i] - m] = True
            return on, True, it + 1
        enter = out + m if out < m else out - m
        row = _leaving(T, enter, basis, m, z0)
        if row < 0:
            return on, False, it + 1
    return on, False, limit


@njit(cache=True, error_model="numpy")
def solve(
    M: np.ndarray,
    r: np.ndarray,
    a: np.ndarray,
    b: np.ndarray,
    on: np.ndarray,
    lam: np.ndarray,
    w: np.ndarray,
) -> tuple[bool, int]:
    """Fill lam and w with a solution and `on` with its support; `on` is a guess before.

    M (m, m); r, on, lam, w (m,); a, b (m,): `scales` of M. Returns whether a solution was found,
    and pivots, supports that were tried included.
    """
    m = r.size
    if by_support(M, r, on, lam, w):
        return True, 0
    S = np.empty((m, m))
    s = np.empty(m)
    top = 0.0
    # Scaled data: rows and columns near one, and the right-hand side too.
    for i in range(m):
        s[i] = a[i] * r[i]
        top = max(top, abs(s[i]))
        for j in range(m):
            S[i, j] = M[i, j] * a[i] * b[j]
    for i in range(m):
        s[i] = s[i] / top if top > 0.0 else s[i]
    guess, found, count = lemke(S, s)
    if found and by_support(M, r, guess, lam, w):
        for i in range(m):
            on[i] = guess[i]
        return True, count
    if m <= ENUMERATED_ROWS:
        # enumeration of the supports; bits of the code say which rows are on
        for code in range(2**m):
            for i in range(m):
                guess[i] = (code >> i) & 1
            if by_support(M, r, guess, lam, w):
                for i in range(m):
                    on[i] = guess[i]
                return True, count + code + 1
    return False, count


@inner_kernel
def has_other_motion(
    M: np.ndarray, r: np.ndarray, G: np.ndarray, lam: np.ndarray, size: float
) -> bool:
    """Is there a solution mu with G mu apart from G lam by more than MOTION times `size`?

    M (m, m), r (m,): the problem; lam (m,): a solution of it. G (n, m): motion per unit of lam.
    """
    m = r.size
    on = np.zeros(m, np.bool_)
    mu = np.empty(m)
    w = np.empty(m)
    # enumeration of the supports; bits of the code say which rows are on
    for code in range(2**m):
        for i in range(m):
            on[i] = (code >> i) & 1
        if by_support(M, r, on, mu, w):
            for c in range(G.shape[0]):
                apart = 0.0
                for i in range(m):
                    apart += G[c, i] * (mu[i] - lam[i])
                if abs(apart) > MOTION * size:
                    return True
    return False


@inner_kernel
def _null_space_projector(Vt, rank, b, idx):
    """Return the orthogonal projector (p, p) onto the null space that the rows `rank` .. of Vt span
    after the scaling b of the columns idx is undone."""
    p = idx.size
    Q = np.empty((p, p - rank))
    for i in range(p):
        for k in range(p - rank):
            Q[i, k] = Vt[rank + k, i] * b[idx[i]]
    orthonormal(Q)
    P = np.zeros((p, p))
    for i in range(p):
        for j in range(p):
            for k in range(Q.shape[1]):
                P[i, j] += Q[i, k] * Q[j, k]
    return P


@inner_kernel
def least_norm_solution(
    M: np.ndarray, r: np.ndarray, a: np.ndarray, b: np.ndarray, lam: np.ndarray, w: np.ndarray
) -> None:
    """Replace lam by the least-norm solution with the same rows w = 0, if these leave a choice.

    On the rows with w = 0 the solutions are an affine set cut by lam >= 0: a least-distance problem
    in its coordinates, whose dual is a Gram problem for lcp.gram_lcp.
    M (m, m), r (m,); a, b (m,): `scales` of M; lam, w (m,): a solution, in and out.
    """
    m = r.size
    zero = np.zeros(m, np.bool_)
    for i in range(m):
        size = abs(r[i])
        for j in range(m):
            size += abs(M[i, j] * lam[j])
        zero[i] = w[i] <= SIGN * size
    idx = np.flatnonzero(zero)
    p = idx.size
    if p < 2:
        return
    S = np.empty((p, p))
    for i in range(p):
        for j in range(p):
            S[i, j] = M[idx[i], idx[j]] * a[idx[i]] * b[idx[j]]
    if not near_singular(S.copy(), RANK):
        return
    # The null space of the scaled rows, by singular values: there the solutions differ.
    _, sigma, Vt = np.linalg.svd(S)
    rank = 0
    while rank < p and sigma[rank] > RANK * sigma[0]:
        rank += 1
    if rank == p:
        return
    P = _null_space_projector(Vt, rank, b, idx)
    start = np.empty(p)
    for i in range(p):
        start[i] = lam[idx[i]]
    along = np.zeros(p)
    top = 0.0
    for i in range(p):
        for j in range(p):
            along[i] += P[i, j] * start[j]
    # Start from the point of the affine set next to the origin.
    for i in range(p):
        start[i] -= along[i]
        top = max(top, lam[idx[i]])
    mu = solve_lcp(P, start, np.empty(0, np.int64), np.full(p, SIGN * top), 1e-14)[0]
    other = np.zeros(m)
    v = np.empty(m)
    for i in range(p):
        for j in range(p):
            start[i] += P[i, j] * mu[j]
        other[idx[i]] = max(start[i], 0.0)
    if slack(M, r, other, v):
        for i in range(m):
            lam[i] = other[i]
            w[i] = v[i]
