"""Exact projection QP of few rows: block exchange, projected Newton, then dual active set.

Warm-started from the step before:

    min 1/2 |d|^2  s.t.  q + G d >= 0        d = G^T mu,    0 <= mu  _|_  w = q + G G^T mu >= 0

G (m, n) sparse, m constraints of any rank: duplicates, hexagonal packings. Three phases, all on
sparse factors of M_AA = G_A G_A^T computed anew in each round: in a time loop G changes in every
step, so there is nothing to update.

1. Block exchange: solve w = 0 on the set A, then remove all mu < 0 and add all w < 0 at once. From
   the active set of the step before this is usually done in one or two rounds. It may cycle, so it
   ends when the number of wrong signs has not fallen for three rounds (Judice & Pires, Computers &
   Operations Research 21(5), 1994).
2. If many signs are wrong: projected Newton on the dual (Bertsekas, SIAM J. Control Optim.
   20(2), 1982). Free are the rows with mu > 0 or w < 0, the step is cut back along max(mu + t p, 0)
   until the dual value falls enough, so no set can cycle. A shift of the diagonal keeps p finite
   where rows depend.
3. The dual method of Goldfarb & Idnani (Mathematical Programming 27, 1983) from the best mu >= 0 at
   hand, made basic: one violated row at a time, the rows that block it leave. The dual value falls
   with each row taken in, so no set comes back; the active rows stay independent; a violated row
   that nothing blocks proves that there is no feasible point.
"""

import numpy as np

from nsbench.compilation.decorators import inner_kernel, njit
from nsbench.linalg.sparse_ldl import (
    SparsityPattern,
    back,
    choose,
    factor,
    lengths,
    nested_dissection_order,
    push,
    slack,
    visits,
)
from nsbench.qp.kernels.dual_active_set import (
    DEPENDENT,
    EPS,
    INFEASIBLE,
    MAXITER,
    SOLVED,
    dual_active_set,
    equality,
    reduce_to_independent_rows,
    rounding,
)

__all__ = ["INFEASIBLE", "MAXITER", "SOLVED", "pattern", "residual", "slack", "solve"]

SHIFT = 0.1  # of the diagonal in phase 2, times the residual: regularised Newton, fast at the end
# rounds of phase 2; the least part of a step
NEWTON_ROUNDS = 100
SHORTEST_STEP = 1e-10
PATIENCE = 3  # rounds of phase 1 without progress
# wrong signs from which on phase 2 pays: phase 3 needs a round for each at least, phase 2 about as
# many for all
MANY_WRONG = 50
CLOSE = 1e-3  # the "epsilon" of projected Newton: any positive number will do


@njit(cache=True, error_model="numpy")
def pattern(ptr: np.ndarray, cols: np.ndarray, n: int) -> SparsityPattern:
    """Return the SparsityPattern of the CSR pattern ptr (m + 1,), cols (e,) with n columns."""
    P = outline(ptr, cols, n)
    order_rows(P)
    return P


@njit(cache=True, error_model="numpy")
def outline(ptr: np.ndarray, cols: np.ndarray, n: int) -> SparsityPattern:
    """Return the SparsityPattern of ptr (m + 1,), cols (e,) without an order of elimination.

    The assembly tree of large problems has an order of its own.
    """
    tptr, trow, tpos = visits(ptr, cols, n)
    return SparsityPattern(ptr, cols, tptr, trow, tpos, np.full(ptr.size - 1, -1))


@inner_kernel
def order_rows(P: SparsityPattern) -> None:
    """Compute the order of elimination of a SparsityPattern if it has none."""
    ptr, cols, tptr, trow, _, order = P
    if order.size > 0 and order[0] < 0:
        new = nested_dissection_order(ptr, cols, tptr, trow)
        for k in range(order.size):
            order[k] = new[k]


@inner_kernel
def exchange(
    on: np.ndarray,
    P: SparsityPattern,
    vals: np.ndarray,
    q: np.ndarray,
    norm: np.ndarray,
    scale: float,
    mu: np.ndarray,
    d: np.ndarray,
    w: np.ndarray,
    slot: np.ndarray,
) -> tuple[bool, int, int]:
    """Exchange all rows of wrong sign at once (phase 1).

    on (m,): the set A, in and out. q, norm, mu, w (m,), d (n,): as for `solve`; norm: lengths of
    the rows; slot (m,): work. Returns whether all signs are right, how many were wrong at
    first, and the rounds taken.
    """
    best = on.size + 1
    chances = PATIENCE
    rounds = 0
    first = 0
    # block principal pivoting (Judice & Pires 1994): all rows of wrong sign change at once
    while True:
        equality(on, P, vals, q, norm, DEPENDENT, EPS * scale, mu, d, w, slot)
        rounds += 1
        tol = rounding(scale, mu, norm)
        wrong = 0
        off = 0.0
        for k in range(on.size):
            off = max(off, abs(w[k]) / norm[k]) if on[k] else off
        if (
            not max(tol, off) <= np.sqrt(EPS) * scale
        ):  # almost dependent rows that contradict: all is rounding
            return False, first, rounds
        for k in range(on.size):
            if (on[k] and mu[k] * norm[k] < -tol) or (not on[k] and w[k] < -tol * norm[k]):
                wrong += 1
        first = wrong if rounds == 1 else first
        if wrong == 0:
            return True, first, rounds
        chances = PATIENCE if wrong < best else chances - 1
        best = min(best, wrong)
        if chances == 0:
            return False, first, rounds
        for k in range(on.size):
            if on[k]:
                on[k] = mu[k] * norm[k] >= -tol
            else:
                on[k] = w[k] < -tol * norm[k]


@inner_kernel
def dual(
    P: SparsityPattern, vals: np.ndarray, q: np.ndarray, mu: np.ndarray, d: np.ndarray
) -> float:
    """Return the dual value q mu + |G^T mu|^2 / 2, q, mu (m,), to be minimised.

    Fills d (n,) with G^T mu.
    """
    push(P, vals, mu, d)
    s = 0.0
    for k in range(q.size):
        s += q[k] * mu[k]
    for c in range(d.size):
        s += 0.5 * d[c] * d[c]
    return s


@inner_kernel
def newton(on, P: SparsityPattern, vals, q, norm, scale, mu, d, w, slot) -> int:
    """Take projected Newton steps on the dual from mu >= 0, mu (m,) (phase 2).

    On return `on` (m,) is the support. d (n,), w (m,): written. Returns rounds.
    """
    ptr, cols, tptr, trow, tpos, order = P
    m = q.size
    trial = np.empty(q.size)
    e = np.empty(d.size)
    p = np.empty(q.size)
    free = np.zeros(m, np.bool_)
    value = dual(P, vals, q, mu, d)
    rounds = 0
    # projected Newton (Bertsekas 1982) with the step cut back along max(mu + t p, 0)
    while rounds < NEWTON_ROUNDS:
        slack(P, vals, q, d, w)
        tol = rounding(scale, mu, norm)
        near = 0.0
        rounds = rounds + 1
        if not tol <= np.sqrt(EPS) * scale:  # no bound below: the rows contradict each other
            break
        for k in range(m):  # how far from the end, as a length
            near = max(near, abs(min(mu[k] * norm[k], w[k] / norm[k])))
        if near <= tol:
            break
        for k in range(m):  # almost zero and about to be: a step of its own
            free[k] = w[k] < 0.0 or mu[k] * norm[k] > min(near, CLOSE * scale)
            p[k] = -w[k] / (norm[k] * norm[k])
        act = choose(free, order, slot)
        L, D = factor(act, slot, ptr, cols, vals, tptr, trow, tpos, 0.0, SHIFT * near / scale)
        b = np.empty(act.size)
        for i in range(act.size):
            b[i] = -w[act[i]]
        back(L, D, b)
        for i in range(act.size):
            p[act[i]] = b[i]
        # Armijo's rule along the projected path: halve the step until the dual value falls enough
        t = 2.0
        new = np.inf
        while t > SHORTEST_STEP:
            t *= 0.5
            slope = 0.0
            for k in range(m):
                trial[k] = max(mu[k] + t * p[k], 0.0)
                slope += w[k] * ((trial[k] - mu[k]) if not free[k] else t * p[k])
            new = dual(P, vals, q, trial, e)
            if new <= value + 1e-4 * slope:
                break
        if not new < value - EPS * abs(value):
            break
        value = new
        for k in range(m):
            mu[k] = trial[k]
        for c in range(d.size):
            d[c] = e[c]
    for k in range(m):
        on[k] = mu[k] > 0.0
    return rounds


@njit(cache=True, error_model="numpy")
def solve(
    P: SparsityPattern, vals: np.ndarray, q: np.ndarray, guess: np.ndarray, scale: float
) -> tuple[np.ndarray, np.ndarray, int, int]:
    """Solve the projection QP for the pattern P of G (m, n), its entries vals and q (m,).

    guess (m,): multipliers to start from, such as those of the step before (those > 0 count).
    scale: size of the numbers the gaps are made of. Returns mu (m,), d = G^T mu (n,), code (SOLVED,
    INFEASIBLE, MAXITER), rounds = factorisations.
    """
    m = q.size
    mu = np.zeros(m)
    d = np.zeros(P.tptr.size - 1)
    w = np.empty(m)
    on = np.empty(m, np.bool_)
    for k in range(m):
        on[k] = guess[k] > 0.0
    # phase 1 from the guess; where it gives up, phases 2 and 3 from the guess again
    norm = lengths(P, vals)
    slot = np.empty(m, np.int64)
    done, wrong, rounds = exchange(on, P, vals, q, norm, scale, mu, d, w, slot)
    code = SOLVED
    if not done:
        for k in range(m):
            on[k] = guess[k] > 0.0
            mu[k] = max(guess[k], 0.0)
        if wrong > MANY_WRONG:
            rounds += newton(on, P, vals, q, norm, scale, mu, d, w, slot)
        rounds += reduce_to_independent_rows(on, P, vals, mu, norm, slot)
        code, more = dual_active_set(on, P, vals, q, norm, scale, mu, d, w, slot)
        rounds += more
    for k in range(m):
        mu[k] = max(mu[k], 0.0) if on[k] else 0.0
    push(P, vals, mu, d)
    return mu, d, code, rounds


@njit(cache=True, error_model="numpy")
def residual(
    P: SparsityPattern, vals: np.ndarray, q: np.ndarray, mu: np.ndarray, d: np.ndarray
) -> float:
    """Return how far d (n,), mu (m,) is from solving the projection QP, as a length: the largest of

        stationarity     |d - G^T mu|
        primal           -w_k / |G_k|                       w = q + G d
        sign             -mu_k |G_k|
        complementarity  min(mu_k |G_k|, w_k / |G_k|)

    mu_k |G_k| is how far row k moves the point, w_k / |G_k| how far the point is from row k, so
    nothing changes when a gap is multiplied by a number. (The last three are |min(mu_k |G_k|, w_k /
    |G_k|)|.) NaN where data is not finite.
    """
    worst = 0.0
    e = np.empty(d.size)
    w = np.empty(q.size)
    norm = lengths(P, vals)
    push(P, vals, mu, e)
    slack(P, vals, q, d, w)
    for c in range(d.size):
        v = abs(d[c] - e[c])
        if not v <= worst:
            worst = v
    for k in range(q.size):
        v = abs(min(mu[k] * norm[k], w[k] / norm[k]))
        if not v <= worst:
            worst = v
    return worst
