"""Time loop of the catching-up scheme: Euler, linearised gaps, least-distance problem.

Hard particles come from neighbour lists under a certificate. A list holds every pair whose gap was
at most `skin` when it was built. Gaps of discs are convex, so a linearised gap falls by no more
than the two particles move; if each has moved by at most skin / 2 since then, the step just solved
included, no pair left out can be violated by it, and the step is the one over all pairs. Otherwise
the list is built anew, longer if one step alone is the reason, and the step is done again.
"""

from typing import NamedTuple

import numpy as np

from nsbench.compilation.decorators import njit
from nsbench.dynamics.contacts.kernels.contact_arrays import PAIR, ROW
from nsbench.dynamics.contacts.kernels.impulse_records import flush
from nsbench.qp.kernels import active_set
from nsbench.qp.kernels.dispatch import solve_projection
from nsbench.solvers.catching_up.kernels.candidates import (
    carry_multipliers,
    gather,
    gradient_pattern,
)
from nsbench.solvers.common.kernels.step_code import StepCode, all_finite

QPS, ROUNDS, REBUILDS, PEAK, LIMITS, TIES, WORST, ACTING = range(8)  # places of the counters
SKIN_OVER_STEP = 8.0  # skin over the displacement of a step: a list should outlive its own step


class CatchingUpResult(NamedTuple):
    """The result of one run.

    x, reaction (K, n): states and integrals of the reaction at the recorded times, NaN behind the
    end. ids (R, 4), values (R,): records of impulse. counters (8,): see the places above. worst,
    when: the largest KKT residual of a step, and the time of that step. code: a StepCode. reached:
    the time of the last step.
    """

    x: np.ndarray
    reaction: np.ndarray
    ids: np.ndarray
    values: np.ndarray
    counters: np.ndarray
    worst: float
    when: float
    code: int
    reached: float


@njit(cache=True, error_model="numpy")
def linearise(contacts, rows, b, anchors, x, ptr, vals, g):
    """Fill the gaps g (m,) and the entries vals of their gradients at x (n,).

    contacts: ListedContacts; rows: AffineRows; ptr (m + 1,): first entry of each gradient. A
    distance of zero has the first axis for its direction.
    """
    kind = contacts.kind
    p = contacts.p
    q = contacts.q
    d = contacts.d
    sign = contacts.sign
    dim = contacts.dim
    for k in range(kind.size):
        at = ptr[k]
        if kind[k] == ROW:
            s = b[p[k]]
            for e in range(rows.ptr[p[k]], rows.ptr[p[k] + 1]):
                s += rows.vals[e] * x[rows.cols[e]]
                vals[at] = rows.vals[e]
                at += 1
            g[k] = s
            continue
        s = 0.0
        for c in range(dim[k]):
            e = x[p[k] + c] - (x[q[k] + c] if kind[k] == PAIR else anchors[q[k] + c])
            vals[at + c] = e
            s += e * e
        r = np.sqrt(s)
        g[k] = sign[k] * (r - d[k])
        if r == 0.0:
            vals[at] = 1.0
            r = 1.0
        for c in range(dim[k]):
            vals[at + c] *= sign[k] / r
            if kind[k] == PAIR:
                vals[at + dim[k] + c] = -vals[at + c]


@njit(cache=True, error_model="numpy")
def largest_displacements(base, x, z, d, hard):
    """Return the largest displacements of hard particles, base -> x -> z + d and x -> z + d."""
    far = 0.0
    last = 0.0
    for u in range(hard.shape[0]):
        _, start, n, dim = hard[u]
        for i in range(n):
            s = 0.0
            v = 0.0
            for c in range(start + i * dim, start + (i + 1) * dim):
                s += (x[c] - base[c]) ** 2
                v += (z[c] + d[c] - x[c]) ** 2
            far = max(far, np.sqrt(s) + np.sqrt(v))
            last = max(last, np.sqrt(v))
    return far, last


@njit(cache=True, error_model="numpy")
def project(exact, many, contacts, ptr, P, book, store, rows, b, anchors, x, z, guess, count):
    """Solve for the point y nearest to z where the gaps linearised at x are not negative.

    exact, many, book, store: see qp.kernels.dispatch; ptr, P: pattern of the gradients; guess (m,):
    multipliers to begin with; count: counters. Returns mu (m,), d = y - z (n,), the code of
    active_set, the KKT residual, book, store.
    """
    m = guess.size
    vals = np.empty(ptr[m])
    w = np.empty(m)
    q = np.empty(m)
    scale = 1.0
    linearise(contacts, rows, b, anchors, x, ptr, vals, w)
    e = np.empty(x.size)
    work = np.zeros(4, np.int64)
    for c in range(x.size):
        scale = max(scale, abs(x[c]), abs(z[c]))
        e[c] = z[c] - x[c]
    active_set.slack(P, vals, w, e, q)
    clear = True
    for k in range(m):
        clear = clear and q[k] >= 0.0
    if clear:
        return np.zeros(m), np.zeros(x.size), np.int64(active_set.SOLVED), 0.0, book, store
    mu, d, book, store = solve_projection(exact, many, P, book, store, vals, q, guess, scale, work)
    count[QPS] += 1
    count[ROUNDS] += work[1]
    count[WORST] = max(count[WORST], work[1])
    count[LIMITS] += work[0] == active_set.MAXITER
    for k in range(m):  # an impulse between coincident centres has no direction
        count[TIES] += (
            contacts.kind[k] != ROW and mu[k] > 0.0 and w[k] == -contacts.sign[k] * contacts.d[k]
        )
    return mu, d, work[0], active_set.residual(P, vals, q, mu, d), book, store


@njit(cache=True, error_model="numpy")
def march(
    f, b_of, a_of, exact, many, moving, t, substeps, x, static, rows, b, anchors, hard, radii, reach
):
    """Integrate from x (n,); returns a CatchingUpResult.

    f, b_of, a_of: pointers (t, x, out), (t, out), (t, out); moving: whether the last two depend on
    t; exact, many: functions of qp.kernels.dispatch; t (K,), substeps (K - 1,): the grid; static:
    ListedContacts by family; rows: AffineRows; hard (k, 4), radii: see gather; reach: least skin.
    """
    K = t.size
    n = x.size
    X = np.empty((K, n))
    R = np.empty((K, n))
    for k in range(K):
        for c in range(n):
            X[k, c] = R[k, c] = np.nan
    x = x.copy()
    reac = np.zeros(n)
    v = np.empty(n)
    base = x.copy()
    z = np.empty(n)
    ids = np.empty((64, 4), np.int64)
    values = np.empty(64)
    size = np.int64(0)
    count = np.zeros(8, np.int64)
    skin = reach
    contacts, keys = gather(x, skin, static, hard, radii)
    ptr, cols = gradient_pattern(contacts, rows.ptr, rows.cols)
    P = active_set.outline(ptr, cols, n)
    guess = np.zeros(keys.size)
    total = np.zeros(keys.size)
    book = np.zeros(2, np.int64)
    store = np.empty(1)
    count[REBUILDS], count[PEAK] = 1, keys.size
    for c in range(n):
        X[0, c] = x[c]
        R[0, c] = 0.0
    worst = 0.0
    when = t[0]
    for k in range(K - 1):
        h = (t[k + 1] - t[k]) / substeps[k]
        for s in range(substeps[k]):
            now = t[k] + s * h
            after = t[k + 1] if s + 1 == substeps[k] else t[k] + (s + 1) * h
            f(now, x, v)
            for c in range(n):
                z[c] = x[c] + h * v[c]
            if not all_finite(z):
                end = worst, when, StepCode.NAN, now
                return CatchingUpResult(X, R, ids[:size], values[:size], count, *end)
            if moving:
                b_of(after, b)
                a_of(after, anchors)
            # solve the step, and again over a longer list where the list is not certified for it
            while True:
                mu, d, code, kkt, book, store = project(
                    exact, many, contacts, ptr, P, book, store, rows, b, anchors, x, z, guess, count
                )
                far, last = largest_displacements(base, x, z, d, hard)
                if code == active_set.INFEASIBLE or not 2.0 * far > skin:
                    break
                ids, values, size = flush(
                    k + 1, total, contacts.family, contacts.i, contacts.j, ids, values, size
                )
                skin = max(reach, SKIN_OVER_STEP * last)
                contacts, new = gather(x, skin, static, hard, radii)
                ptr, cols = gradient_pattern(contacts, rows.ptr, rows.cols)
                P = active_set.outline(ptr, cols, n)
                guess = carry_multipliers(keys, mu, new)
                keys = new
                total = np.zeros(new.size)
                book[0] = 0
                for c in range(n):
                    base[c] = x[c]
                count[REBUILDS] += 1
                count[PEAK] = max(count[PEAK], keys.size)
            if not kkt <= worst:
                worst = kkt
                when = now
            if code == active_set.INFEASIBLE:
                end = worst, when, StepCode.INFEASIBLE, now
                return CatchingUpResult(X, R, ids[:size], values[:size], count, *end)
            for c in range(n):
                x[c] = z[c] + d[c]
                reac[c] += d[c]
            for c in range(mu.size):
                total[c] += mu[c]
                count[ACTING] += mu[c] > 0.0
            guess = mu
            if not all_finite(x):
                end = worst, when, StepCode.NAN, now
                return CatchingUpResult(X, R, ids[:size], values[:size], count, *end)
        for c in range(n):
            X[k + 1, c] = x[c]
            R[k + 1, c] = reac[c]
        ids, values, size = flush(
            k + 1, total, contacts.family, contacts.i, contacts.j, ids, values, size
        )
    end = worst, when, StepCode.OK, t[K - 1]
    return CatchingUpResult(X, R, ids[:size], values[:size], count, *end)
