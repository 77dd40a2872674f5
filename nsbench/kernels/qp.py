"""The least-distance problem of one step by an active set that is kept from step to step.

    min 1/2 |d|^2  s.t.  q + G d >= 0        d = G^T mu,    0 <= mu  _|_  w = q + G G^T mu >= 0

G (m, n) sparse, m constraints of any rank: duplicates, hexagonal packings. Two phases, both on sparse factors of
M_AA = G_A G_A^T made anew in each round: in a time loop G changes in every step, so there is nothing to update.

1. Exchange: solve w = 0 on the set A, then put out all mu < 0 and take in all w < 0 at once. From the active set of
   the step before this is usually done in one or two rounds. It may cycle, so it ends when the number of wrong signs
   has not fallen for three rounds (Judice & Pires, Computers & Operations Research 21(5), 1994).
2. The dual method of Goldfarb & Idnani (Mathematical Programming 27, 1983) from what is left of A: one violated row
   at a time, the rows that block it leave. The dual value grows with each row taken in, so no set comes back; the
   active rows stay independent; a violated row that nothing blocks proves that the problem has no feasible point.
"""
import numpy as np
from numba import njit

from nsbench.kernels.sparse import back, dissection, factor, visits

SOLVED, INFEASIBLE, MAXITER = 0, 1, 2
EPS = 2.0**-52
DEPENDENT = 1e-12            # squared sine of the angle to the span: below it 1/sine^2 eats more digits than refinement returns
NO_FACTOR = 1e-15            # phase 2 decides on dependence itself; the factor refuses only what rounding makes of zero


@njit(cache=True, error_model="numpy")
def pattern(ptr, cols, n):
    """All that depends only on where G has entries: ptr, cols, their transpose, and an order of elimination."""
    tptr, trow, tpos = visits(ptr, cols, n)
    return ptr, cols, tptr, trow, tpos, dissection(ptr, cols, tptr, trow)


@njit(cache=True, error_model="numpy")
def push(P, vals, mu, d):
    """d = G^T mu."""
    ptr, cols = P[0], P[1]
    d[:] = 0.0
    for k in range(mu.size):
        if mu[k] != 0.0:
            for e in range(ptr[k], ptr[k + 1]):
                d[cols[e]] += vals[e] * mu[k]


@njit(cache=True, error_model="numpy")
def slack(P, vals, q, d, w):
    """w = q + G d."""
    ptr, cols = P[0], P[1]
    for k in range(q.size):
        s = q[k]
        for e in range(ptr[k], ptr[k + 1]):
            s += vals[e] * d[cols[e]]
        w[k] = s


@njit(cache=True, error_model="numpy")
def lengths(P, vals):
    """|grad g_k| of every row."""
    ptr, out = P[0], np.empty(P[0].size - 1)
    for k in range(out.size):
        s = 0.0
        for e in range(ptr[k], ptr[k + 1]):
            s += vals[e] * vals[e]
        out[k] = np.sqrt(s)
    return out


@njit(cache=True, error_model="numpy")
def choose(on, order, slot):
    """The rows switched on, in the order of elimination; slot: their places, -1 elsewhere."""
    act, na = np.empty(on.size, np.int64), 0
    for k in order:
        slot[k] = -1
        if on[k]:
            slot[k] = na
            act[na] = k
            na += 1
    return act[:na]


@njit(cache=True, error_model="numpy")
def equality(on, P, vals, q, norm, dependent, eps, mu, d, w, slot):
    """mu with w = 0 on the rows switched on; rows that depend on others are switched off. Returns act, L, D."""
    ptr, cols, tptr, trow, tpos, order = P
    act = choose(on, order, slot)
    L, D = factor(act, slot, ptr, cols, vals, tptr, trow, tpos, dependent)
    for i in range(act.size):
        if D[i] == 0.0:
            on[act[i]] = False
    mu[:] = 0.0
    d[:] = 0.0
    w[:] = q
    b, before = np.empty(act.size), np.inf
    for _ in range(6):                                # a solve and its refinement with the true residual
        worst = 0.0
        for i in range(act.size):
            b[i] = -w[act[i]]
            if D[i] != 0.0:
                worst = max(worst, abs(b[i]) / norm[act[i]])
        if worst <= eps or not worst < 0.5 * before:
            break
        before = worst
        back(L, D, b)
        for i in range(act.size):
            mu[act[i]] += b[i]
        push(P, vals, mu, d)
        slack(P, vals, q, d, w)
    return act, L, D


@njit(cache=True, error_model="numpy")
def rounding(scale, mu, norm):
    """Length below which a sign is rounding: gaps come from numbers of size `scale`, slacks from mu too."""
    top = 0.0
    for k in range(mu.size):
        top = max(top, abs(mu[k]) * norm[k])
    return 32.0 * EPS * (scale + top)


@njit(cache=True, error_model="numpy")
def exchange(on, P, vals, q, norm, scale, mu, d, w, slot):
    """Phase 1. Returns whether all signs are right, and the rounds taken."""
    best, chances, rounds = on.size + 1, 3, 0
    while True:
        equality(on, P, vals, q, norm, DEPENDENT, EPS * scale, mu, d, w, slot)
        rounds += 1
        tol, wrong = rounding(scale, mu, norm), 0
        for k in range(on.size):
            if (on[k] and mu[k] * norm[k] < -tol) or (not on[k] and w[k] < -tol * norm[k]):
                wrong += 1
        if not tol <= np.sqrt(EPS) * scale:                # almost dependent rows that contradict: all is rounding
            on[:] = False
            return False, rounds
        if wrong == 0:
            return True, rounds
        chances = 3 if wrong < best else chances - 1
        best = min(best, wrong)
        if chances == 0:
            return False, rounds
        for k in range(on.size):
            if on[k]:
                on[k] = mu[k] * norm[k] >= -tol
            else:
                on[k] = w[k] < -tol * norm[k]


@njit(cache=True, error_model="numpy")
def shrink(on, P, vals, q, norm, scale, mu, d, w, slot):
    """Put out negative mu until none is left: a dual feasible start. Returns act, L, D, rounds."""
    rounds = 0
    while True:
        act, L, D = equality(on, P, vals, q, norm, NO_FACTOR, EPS * scale, mu, d, w, slot)
        rounds += 1
        tol, clean = rounding(scale, mu, norm), True
        for k in act:
            if on[k] and mu[k] * norm[k] < -tol:
                on[k] = False
                clean = False
        if clean:
            return act, L, D, rounds


@njit(cache=True, error_model="numpy")
def direction(p, act, L, D, P, vals, slot):
    """r with M_AA r = M_Ap, and |G_p - G_A^T r|^2: what moves when row p is pushed and the set A holds."""
    ptr, cols, tptr, trow, tpos, _ = P
    r = np.zeros(act.size)
    v = np.zeros(tptr.size - 1)
    for e in range(ptr[p], ptr[p + 1]):
        v[cols[e]] += vals[e]
    for _ in range(2):
        b = np.zeros(act.size)
        for i in range(act.size):
            for e in range(ptr[act[i]], ptr[act[i] + 1]):
                b[i] += vals[e] * v[cols[e]]
        back(L, D, b)
        r += b
        for i in range(act.size):
            for e in range(ptr[act[i]], ptr[act[i] + 1]):
                v[cols[e]] -= vals[e] * b[i]
    return r, (v * v).sum()


@njit(cache=True, error_model="numpy")
def take_in(p, on, P, vals, q, norm, scale, mu, d, w, slot, act, L, D, limit):
    """Raise mu_p until row p holds; blocking rows leave. Returns code, the new act, L, D, and rounds."""
    rounds, mup, wp = 0, 0.0, w[p]
    while rounds <= limit:
        r, gain = direction(p, act, L, D, P, vals, slot)
        full = -wp / gain if gain > DEPENDENT * norm[p] * norm[p] else np.inf
        t, leave = full, np.int64(-1)
        for i in range(act.size):
            if D[i] != 0.0 and r[i] > 1e-14 * norm[p] / norm[act[i]]:      # below: rounding of a zero
                s = max(mu[act[i]], 0.0) / r[i]
                if s < t:
                    t, leave = s, act[i]
        if t == np.inf:
            return INFEASIBLE, act, L, D, rounds
        for i in range(act.size):
            mu[act[i]] -= t * r[i]
        mup += t
        wp += t * gain
        if leave < 0:
            on[p] = True
            act, L, D, more = shrink(on, P, vals, q, norm, scale, mu, d, w, slot)
            return SOLVED, act, L, D, rounds + more
        on[leave] = False
        mu[leave] = 0.0
        act = choose(on, P[5], slot)
        L, D = factor(act, slot, P[0], P[1], vals, P[2], P[3], P[4], NO_FACTOR)
        rounds += 1
    return MAXITER, act, L, D, rounds


@njit(cache=True, error_model="numpy")
def one_by_one(on, P, vals, q, norm, scale, mu, d, w, slot):
    """Phase 2. Returns code and rounds."""
    act, L, D, rounds = shrink(on, P, vals, q, norm, scale, mu, d, w, slot)
    limit = 100 + 20 * on.size
    spared = np.zeros(on.size, np.bool_)
    while rounds < limit:
        tol, p, worst = rounding(scale, mu, norm), np.int64(-1), 0.0
        for k in range(on.size):
            if not on[k] and not spared[k] and w[k] / norm[k] < min(-tol, worst):
                p, worst = k, w[k] / norm[k]
        if p < 0:
            return SOLVED, rounds
        code, act, L, D, more = take_in(p, on, P, vals, q, norm, scale, mu, d, w, slot, act, L, D, limit)
        rounds += more
        if code == INFEASIBLE:
            if worst < -np.sqrt(EPS) * scale:
                return INFEASIBLE, rounds
            spared[p] = True                           # contradicts the others by rounding only: the residual shows it
            act, L, D, more = shrink(on, P, vals, q, norm, scale, mu, d, w, slot)
            rounds += more
        elif code == MAXITER:
            break
    return MAXITER, rounds


@njit(cache=True, error_model="numpy")
def solve(P, vals, q, on, scale):
    """Solve the problem for the pattern P, entries vals and right-hand side q (m,).

    on (m,) bool: the set to start from; on return the active set. scale: size of the numbers the gaps are made of.
    Returns mu (m,), d = G^T mu (n,), code (SOLVED, INFEASIBLE, MAXITER), rounds = factorisations.
    """
    m = q.size
    mu, d, w = np.zeros(m), np.zeros(P[2].size - 1), np.empty(m)
    norm, slot = lengths(P, vals), np.empty(m, np.int64)
    done, rounds = exchange(on, P, vals, q, norm, scale, mu, d, w, slot)
    code = SOLVED
    if not done:
        code, more = one_by_one(on, P, vals, q, norm, scale, mu, d, w, slot)
        rounds += more
    for k in range(m):
        mu[k] = max(mu[k], 0.0) if on[k] else 0.0
    push(P, vals, mu, d)
    return mu, d, code, rounds


@njit(cache=True, error_model="numpy")
def residual(P, vals, q, mu, d):
    """How far (d, mu) is from solving the problem, as a length: the largest of

        stationarity     |d - G^T mu|
        primal           -w_k / |G_k|                       w = q + G d
        sign             -mu_k |G_k|
        complementarity  min(mu_k |G_k|, w_k / |G_k|)

    mu_k |G_k| is how far row k moves the point, w_k / |G_k| how far the point is from row k, so nothing changes when
    a gap is multiplied by a number. (The last three are |min(mu_k |G_k|, w_k / |G_k|)|.) NaN where data is not finite.
    """
    worst, e, w, norm = 0.0, np.empty(d.size), np.empty(q.size), lengths(P, vals)
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
