"""The time loop of the catching-up scheme: linearise the gaps, solve the least-distance problem, go
on.

Hard particles come from near lists under a certificate. A list holds every pair whose gap was at
most `skin` when it was built. Gaps of discs are convex, so a linearised gap falls by no more than
the two particles move; if each has moved by at most skin / 2 since then, the step just solved
included, no pair left out can be violated by it, and the step is the one over all pairs. Otherwise
the list is built anew, longer if one step alone is the reason, and the step done again.
"""

import numpy as np

from nsbench.compilation.decorators import njit
from nsbench.dynamics.contacts.kernels.impulse_records import flush
from nsbench.qp.kernels import active_set
from nsbench.qp.kernels.dispatch import solve_projection
from nsbench.solvers.catching_up.kernels.candidates import carry, columns, gather
from nsbench.solvers.pbd.kernels.listed_loop import NAN, OK, finite

INFEASIBLE = 3
QPS, ROUNDS, REBUILDS, PEAK, LIMITS, TIES, WORST, ACTING = range(8)  # places of the counters
SKIN_OVER_STEP = 8.0  # a list should outlive its own step


@njit(cache=True, error_model="numpy")
def linearise(lists, rows, b, anchors, x, ptr, vals, g):
    """Fill g (m,) and the entries of the gradients at x. A distance of zero has the first axis for
    a direction."""
    kind, _, _, _, p, q, d, sign, dim = lists
    rptr = rows[0]
    rcols = rows[1]
    rvals = rows[2]
    for k in range(kind.size):
        at = ptr[k]
        if kind[k] == 0:
            s = b[p[k]]
            for e in range(rptr[p[k]], rptr[p[k] + 1]):
                s += rvals[e] * x[rcols[e]]
                vals[at] = rvals[e]
                at += 1
            g[k] = s
            continue
        s = 0.0
        for c in range(dim[k]):
            e = x[p[k] + c] - (x[q[k] + c] if kind[k] == 1 else anchors[q[k] + c])
            vals[at + c] = e
            s += e * e
        r = np.sqrt(s)
        g[k] = sign[k] * (r - d[k])
        if r == 0.0:
            vals[at] = 1.0
            r = 1.0
        for c in range(dim[k]):
            vals[at + c] *= sign[k] / r
            if kind[k] == 1:
                vals[at + dim[k] + c] = -vals[at + c]


@njit(cache=True, error_model="numpy")
def travel(base, x, z, d, hard):
    """The farthest way of a hard particle base -> x -> y = z + d, and of x -> y alone."""
    far = 0.0
    last = 0.0
    for u in range(hard.shape[0]):
        start = hard[u, 1]
        n = hard[u, 2]
        dim = hard[u, 3]
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
def project(exact, many, lists, P, book, store, rows, b, anchors, x, z, guess, count):
    """The point nearest to z where the gaps linearised at x are not negative.

    exact, many, book, store: see kernels.least. Returns mu, d = y - z, code, residual, book, store.
    """
    m = guess.size
    vals = np.empty(P[1].size)
    w = np.empty(m)
    q = np.empty(m)
    scale = 1.0
    linearise(lists, rows, b, anchors, x, P[0], vals, w)
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
    for k in range(m):  # a push between coincident centres has no direction
        count[TIES] += lists[0][k] != 0 and mu[k] > 0.0 and w[k] == -lists[7][k] * lists[6][k]
    return mu, d, work[0], active_set.residual(P, vals, q, mu, d), book, store


@njit(cache=True, error_model="numpy")
def march(
    f, b_of, a_of, exact, many, moving, t, substeps, x, static, rows, b, anchors, hard, radii, reach
):
    """Samples of one run. Arguments as kernels.pbd_near.march (static: arrays of the listed
    constraints, by family).

    exact, many: the functions of kernels.least.

    Returns X (K, n), reaction (K, n), ids, values (records of impulse), counters, the worst KKT
    residual with the time of its step, status, time reached.
    """
    K = t.size
    n = x.size
    X = np.empty((K, n))
    R = np.empty((K, n))
    for k in range(K):
        for c in range(n):
            X[k, c] = R[k, c] = np.nan
    x, reac, v, base, z = x.copy(), np.zeros(n), np.empty(n), x.copy(), np.empty(n)
    ids = np.empty((64, 4), np.int64)
    values = np.empty(64)
    size = np.int64(0)
    count = np.zeros(8, np.int64)
    skin = reach
    lists, keys = gather(x, skin, static, hard, radii)
    P = active_set.outline(*columns(lists, rows[0], rows[1]), n)
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
            if not finite(z):
                return X, R, ids[:size], values[:size], count, worst, when, NAN, now
            if moving:
                b_of(after, b)
                a_of(after, anchors)
            while True:
                mu, d, code, kkt, book, store = project(
                    exact, many, lists, P, book, store, rows, b, anchors, x, z, guess, count
                )
                far, last = travel(base, x, z, d, hard)
                if code == active_set.INFEASIBLE or not 2.0 * far > skin:
                    break
                ids, values, size = flush(
                    k + 1, total, lists[1], lists[2], lists[3], ids, values, size
                )
                skin = max(reach, SKIN_OVER_STEP * last)
                lists, new = gather(x, skin, static, hard, radii)
                P = active_set.outline(*columns(lists, rows[0], rows[1]), n)
                guess = carry(keys, mu, new)
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
                return X, R, ids[:size], values[:size], count, worst, when, INFEASIBLE, now
            for c in range(n):
                x[c] = z[c] + d[c]
                reac[c] += d[c]
            for c in range(mu.size):
                total[c] += mu[c]
                count[ACTING] += mu[c] > 0.0
            guess = mu
            if not finite(x):
                return X, R, ids[:size], values[:size], count, worst, when, NAN, now
        for c in range(n):
            X[k + 1, c] = x[c]
            R[k + 1, c] = reac[c]
        ids, values, size = flush(k + 1, total, lists[1], lists[2], lists[3], ids, values, size)
    return X, R, ids[:size], values[:size], count, worst, when, OK, t[K - 1]
