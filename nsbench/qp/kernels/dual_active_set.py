"""Dual active-set method of Goldfarb & Idnani for the projection QP, on sparse factors.

Phase 3 of qp.kernels.active_set: one violated row at a time. The state is a set of independent rows
that are on, their mu >= 0, and the factor (act, L, D) of M_AA = G_A G_A^T.
Source: Goldfarb & Idnani, Mathematical Programming 27, 1983.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from nsbench.compilation.decorators import inner_kernel
from nsbench.linalg.sparse_ldl import back, choose, factor, push, slack

if TYPE_CHECKING:
    from nsbench.linalg.sparse_ldl import SparseFactor, SparsityPattern

SOLVED = 0
INFEASIBLE = 1
MAXITER = 2
EPS = 2.0**-52
# squared sine to the span: below it 1/sine^2 costs more digits than refinement returns
DEPENDENT = 1e-12
# phase 3 decides on dependence itself; the factor refuses only what rounding makes of zero
NO_FACTOR = 1e-15
SOLVES = 6  # one and its refinements, which end when the residual does not halve any more


@inner_kernel
def equality(
    on: np.ndarray,
    P: SparsityPattern,
    vals: np.ndarray,
    q: np.ndarray,
    norm: np.ndarray,
    dependent: float,
    eps: float,
    mu: np.ndarray,
    d: np.ndarray,
    w: np.ndarray,
    slot: np.ndarray,
) -> tuple[np.ndarray, SparseFactor, np.ndarray]:
    """Fill mu, d and w with the solution of w = 0 on the rows that are `on`; rows that depend on
    others are switched off.

    on (m,): in and out; q, norm, mu, w (m,), d (n,). dependent: squared sine to the span that
    counts as zero; eps: residual, a length, at which refinement ends. slot (m,): work. Returns the
    factor act, L, D.
    """
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
    for _ in range(SOLVES):  # iterative refinement with the true residual
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


@inner_kernel
def rounding(scale: float, mu: np.ndarray, norm: np.ndarray) -> float:
    """Return the length below which a sign is rounding.

    Gaps come from numbers of size `scale`, slacks from mu (m,) too; norm (m,): lengths of the rows.
    """
    top = 0.0
    for k in range(mu.size):
        top = max(top, abs(mu[k]) * norm[k])
    return 32.0 * EPS * (scale + top)


@inner_kernel
def direction(
    p: int,
    act: np.ndarray,
    L: SparseFactor,
    D: np.ndarray,
    P: SparsityPattern,
    vals: np.ndarray,
    slot: np.ndarray,
) -> tuple[np.ndarray, float]:
    """Return r with M_AA r = M_Ap, and |G_p - G_A^T r|^2: what moves when row p is pushed and the
    rows A stay at zero.

    act (a,): the rows A, with their factor L, D. Returns r (a,) and the square.
    """
    ptr = P.ptr
    cols = P.cols
    r = np.zeros(act.size)
    v = np.zeros(P.tptr.size - 1)
    for e in range(ptr[p], ptr[p + 1]):
        v[cols[e]] += vals[e]
    # Projection done twice: what rounding leaves after the first goes in the second.
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


@inner_kernel
def reduce_to_independent_rows(
    on: np.ndarray,
    P: SparsityPattern,
    vals: np.ndarray,
    mu: np.ndarray,
    norm: np.ndarray,
    slot: np.ndarray,
) -> int:
    """Replace mu >= 0 on any rows by one on independent rows with the same G^T mu (Caratheodory's
    theorem).

    on, mu (m,): the rows and their multipliers, in and out; norm (m,): lengths of the rows; slot
    (m,): work. Returns rounds.
    """
    rounds = 0
    swapped = True
    # Along the null vector of a dependent row mu moves until one of its entries vanishes.
    while swapped:
        act = choose(on, P.order, slot)
        swapped = False
        L, D = factor(act, slot, P.ptr, P.cols, vals, P.tptr, P.trow, P.tpos, DEPENDENT, 0.0)
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


@inner_kernel
def settle(
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
) -> tuple[np.ndarray, SparseFactor, np.ndarray, int]:
    """Move mu >= 0 on the rows that are `on` to the solution of w = 0 there; rows whose mu vanishes
    on the way leave.

    The dual value falls all the way (Lawson & Hanson 1974, chapter 23). on, mu (m,): in and out; d
    (n,), w (m,): written. Returns act, L, D, rounds.
    """
    rounds = 0
    goal = np.empty(mu.size)
    # Lawson & Hanson's inner loop: solve on the set, cut the step at the first mu that vanishes
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


@inner_kernel
def add_row(
    p: int,
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
    act: np.ndarray,
    L: SparseFactor,
    D: np.ndarray,
    limit: int,
) -> tuple[int, np.ndarray, SparseFactor, np.ndarray, int]:
    """Raise mu_p until row p is satisfied; blocking rows leave.

    on, mu (m,): in and out; d (n,), w (m,): written. Returns code, the new act, L, D, and rounds.
    """
    rounds = 0
    mup = 0.0
    wp = w[p]
    # partial steps to the first row that blocks, then a full one
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
        act = choose(on, P.order, slot)
        L, D = factor(act, slot, P.ptr, P.cols, vals, P.tptr, P.trow, P.tpos, NO_FACTOR, 0.0)
        rounds += 1
    return MAXITER, act, L, D, rounds


@inner_kernel
def dual_active_set(
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
) -> tuple[int, int]:
    """Solve the projection QP from mu >= 0 on independent rows (phase 3).

    on (m,): these rows, in and out; fills mu (m,), d (n,), w (m,); slot (m,): work. norm (m,):
    lengths of the rows; scale: size of the numbers the gaps are made of. Returns SOLVED, INFEASIBLE
    or MAXITER, and rounds.
    """
    act, L, D, rounds = settle(on, P, vals, q, norm, scale, mu, d, w, slot)
    limit = 100 + 20 * on.size
    tolerated = np.zeros(on.size, np.bool_)
    # Goldfarb & Idnani: the row violated most is added, the rows that block it leave
    while rounds < limit:
        tol = rounding(scale, mu, norm)
        p = np.int64(-1)
        worst = 0.0
        for k in range(on.size):
            if not on[k] and not tolerated[k] and w[k] / norm[k] < min(-tol, worst):
                p = k
                worst = w[k] / norm[k]
        if p < 0:
            return SOLVED, rounds
        code, act, L, D, more = add_row(
            p, on, P, vals, q, norm, scale, mu, d, w, slot, act, L, D, limit
        )
        rounds += more
        if code == INFEASIBLE:
            if worst < -np.sqrt(EPS) * scale:
                return INFEASIBLE, rounds
            tolerated[p] = True  # contradicts the others by rounding only: the residual shows it
            act, L, D, more = settle(on, P, vals, q, norm, scale, mu, d, w, slot)
            rounds += more
        elif code == MAXITER:
            break
    return MAXITER, rounds
