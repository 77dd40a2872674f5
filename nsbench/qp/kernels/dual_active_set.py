"""Phase 3 of kernels.qp: one row at a time, by the dual method of Goldfarb & Idnani on sparse
factors.

The state is a set of independent rows that are on, their mu >= 0, and the factor (act, L, D) of
M_AA.
"""

import numpy as np

from nsbench.compilation.decorators import njit
from nsbench.linalg.sparse_ldl import back, choose, factor, push, slack

SOLVED = 0
INFEASIBLE = 1
MAXITER = 2
EPS = 2.0**-52
# squared sine to the span: below it 1/sine^2 eats more digits than refinement returns
DEPENDENT = 1e-12
# phase 3 decides on dependence itself; the factor refuses only what rounding makes of zero
NO_FACTOR = 1e-15


@njit(cache=True, error_model="numpy")
def equality(on, P, vals, q, norm, dependent, eps, mu, d, w, slot):
    """mu with w = 0 on the rows switched on; rows that depend on others are switched off. Returns
    act, L, D."""
    ptr, cols, tptr, trow, tpos, order = P
    act = choose(on, order, slot)
    L, D = factor(act, slot, ptr, cols, vals, tptr, trow, tpos, dependent, 0.0)
    for i in range(act.size):
        if D[i] == 0.0:
            on[act[i]] = False
    for k in range(mu.size):
        mu[k] = 0.0
        w[k] = q[k]
    for c in range(d.size):
        d[c] = 0.0
    b = np.empty(act.size)
    before = np.inf
    for _ in range(6):  # a solve and its refinement with the true residual
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
    """Length below which a sign is rounding: gaps come from numbers of size `scale`, slacks from mu
    too."""
    top = 0.0
    for k in range(mu.size):
        top = max(top, abs(mu[k]) * norm[k])
    return 32.0 * EPS * (scale + top)


@njit(cache=True, error_model="numpy")
def direction(p, act, L, D, P, vals, slot):
    """r with M_AA r = M_Ap, and |G_p - G_A^T r|^2: what moves when row p is pushed and the set A
    holds."""
    ptr = P[0]
    cols = P[1]
    r = np.zeros(act.size)
    v = np.zeros(P[2].size - 1)
    for e in range(ptr[p], ptr[p + 1]):
        v[cols[e]] += vals[e]
    for _ in range(2):
        b = np.zeros(act.size)
        for i in range(act.size):
            for e in range(ptr[act[i]], ptr[act[i] + 1]):
                b[i] += vals[e] * v[cols[e]]
        back(L, D, b)
        for i in range(act.size):
            r[i] += b[i]
            for e in range(ptr[act[i]], ptr[act[i] + 1]):
                v[cols[e]] -= vals[e] * b[i]
    gain = 0.0
    for e in v:
        gain += e * e
    return r, gain


@njit(cache=True, error_model="numpy")
def reduce_to_independent_rows(on, P, vals, mu, norm, slot):
    """From mu >= 0 on any rows to independent ones with the same G^T mu (Caratheodory). Returns
    rounds."""
    rounds = 0
    swapped = True
    while swapped:
        act = choose(on, P[5], slot)
        swapped = False
        L, D = factor(act, slot, P[0], P[1], vals, P[2], P[3], P[4], DEPENDENT, 0.0)
        rounds += 1
        for c in range(act.size):
            if D[c] != 0.0:
                continue
            k = act[c]
            r, _ = direction(k, act, L, D, P, vals, slot)
            t = mu[k]
            leave = k
            for i in range(act.size):
                if (
                    D[i] != 0.0
                    and r[i] < -1e-14 * norm[k] / norm[act[i]]
                    and mu[act[i]] < -t * r[i]
                ):
                    t = -mu[act[i]] / r[i]
                    leave = act[i]
            for i in range(act.size):
                mu[act[i]] = max(mu[act[i]] + t * r[i], 0.0)
            mu[k] -= t
            mu[leave] = 0.0
            on[leave] = False
            if leave != k:
                swapped = True
                break
    return rounds


@njit(cache=True, error_model="numpy")
def settle(on, P, vals, q, norm, scale, mu, d, w, slot):
    """From mu >= 0 on the rows switched on to the solution of w = 0 there; rows whose mu vanishes
    on the way leave.

    The dual value falls all the way (Lawson & Hanson 1974, chapter 23). Returns act, L, D, rounds.
    """
    rounds = 0
    goal = np.empty(mu.size)
    while True:
        act, L, D = equality(on, P, vals, q, norm, NO_FACTOR, EPS * scale, goal, d, w, slot)
        rounds += 1
        tol = rounding(scale, goal, norm)
        t = 1.0
        for k in act:
            if on[k] and goal[k] * norm[k] < -tol:
                t = min(t, mu[k] / (mu[k] - goal[k]))
        if t == 1.0:
            for k in range(mu.size):
                mu[k] = goal[k]
            return act, L, D, rounds
        for k in range(mu.size):
            if on[k] and goal[k] * norm[k] < -tol and mu[k] / (mu[k] - goal[k]) <= t:
                on[k] = False
            mu[k] = max(mu[k] + t * (goal[k] - mu[k]), 0.0) if on[k] else 0.0


@njit(cache=True, error_model="numpy")
def take_in(p, on, P, vals, q, norm, scale, mu, d, w, slot, act, L, D, limit):
    """Raise mu_p until row p holds; blocking rows leave. Returns code, the new act, L, D, and
    rounds."""
    rounds = 0
    mup = 0.0
    wp = w[p]
    while rounds <= limit:
        r, gain = direction(p, act, L, D, P, vals, slot)
        full = -wp / gain if gain > DEPENDENT * norm[p] * norm[p] else np.inf
        t = full
        leave = np.int64(-1)
        for i in range(act.size):
            if D[i] != 0.0 and r[i] > 1e-14 * norm[p] / norm[act[i]]:  # below: rounding of a zero
                s = max(mu[act[i]], 0.0) / r[i]
                if s < t:
                    t = s
                    leave = act[i]
        if t == np.inf:
            return INFEASIBLE, act, L, D, rounds
        for i in range(act.size):
            mu[act[i]] = max(mu[act[i]] - t * r[i], 0.0)
        mup += t
        wp += t * gain
        if leave < 0:
            on[p] = True
            mu[p] = mup
            act, L, D, more = settle(on, P, vals, q, norm, scale, mu, d, w, slot)
            return SOLVED, act, L, D, rounds + more
        on[leave] = False
        mu[leave] = 0.0
        act = choose(on, P[5], slot)
        L, D = factor(act, slot, P[0], P[1], vals, P[2], P[3], P[4], NO_FACTOR, 0.0)
        rounds += 1
    return MAXITER, act, L, D, rounds


@njit(cache=True, error_model="numpy")
def dual_active_set(on, P, vals, q, norm, scale, mu, d, w, slot):
    """Phase 3. Returns code and rounds."""
    act, L, D, rounds = settle(on, P, vals, q, norm, scale, mu, d, w, slot)
    limit = 100 + 20 * on.size
    spared = np.zeros(on.size, np.bool_)
    while rounds < limit:
        tol = rounding(scale, mu, norm)
        p = np.int64(-1)
        worst = 0.0
        for k in range(on.size):
            if not on[k] and not spared[k] and w[k] / norm[k] < min(-tol, worst):
                p = k
                worst = w[k] / norm[k]
        if p < 0:
            return SOLVED, rounds
        code, act, L, D, more = take_in(
            p, on, P, vals, q, norm, scale, mu, d, w, slot, act, L, D, limit
        )
        rounds += more
        if code == INFEASIBLE:
            if worst < -np.sqrt(EPS) * scale:
                return INFEASIBLE, rounds
            spared[p] = True  # contradicts the others by rounding only: the residual shows it
            act, L, D, more = settle(on, P, vals, q, norm, scale, mu, d, w, slot)
            rounds += more
        elif code == MAXITER:
            break
    return MAXITER, rounds
