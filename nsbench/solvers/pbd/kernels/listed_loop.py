"""The time loop of position-based dynamics over listed constraints: Euler, then sweeps of
projections."""

import numpy as np

from nsbench.compilation.decorators import njit
from nsbench.dynamics.contacts.kernels.impulse_records import flush
from nsbench.solvers.pbd.kernels.projection import sweep

OK = 0
NAN = 1
TIED = 2


@njit(cache=True)
def finite(x):
    """Whether every entry is finite (below 1e150, so that squares are finite too)."""
    for v in x:
        if not abs(v) < 1e150:
            return False
    return True


@njit(cache=True)
def march(f, b_of, a_of, moving, t, substeps, sweeps, x, lists, rows, b, anchors):
    """Samples of one run; the constraints are projected on in the order of `lists`.

    f, b_of, a_of: pointers (t, x, out), (t, out), (t, out); x (n,) start; lists: arrays of
    kernels.project with family, i, j; rows: ptr, cols, vals, inv2. Returns X (K, n), reaction (K,
    n), records, projections, status, time reached.
    """
    kind, family, ci, cj, p, q, d, sign, dim = lists
    ptr, cols, vals, inv2 = rows
    K = t.size
    m = kind.size
    X = np.full((K, x.size), np.nan)
    R = np.full((K, x.size), np.nan)
    x, reac, v, mu = x.copy(), np.zeros(x.size), np.empty(x.size), np.zeros(m)
    ids = np.empty((4 * m + 16, 4), np.int64)
    values = np.empty(4 * m + 16)
    count = 0
    X[0] = x
    R[0] = reac
    work = 0
    status = OK
    for k in range(K - 1):
        h = (t[k + 1] - t[k]) / substeps[k]
        for s in range(substeps[k]):
            now = t[k] + s * h
            f(now, x, v)
            for c in range(x.size):
                x[c] += h * v[c]
                v[c] = x[c]
            if not finite(x):
                return X, R, ids[:count], values[:count], work, NAN, now
            if moving:
                after = t[k + 1] if s + 1 == substeps[k] else t[k] + (s + 1) * h
                b_of(after, b)
                a_of(after, anchors)
            for _ in range(sweeps):
                done, tied = sweep(
                    0, m, 1, kind, p, q, d, sign, dim, x, ptr, cols, vals, inv2, b, anchors, mu
                )
                work += done
                if tied:
                    status = TIED
            for c in range(x.size):
                reac[c] += x[c] - v[c]
        X[k + 1] = x
        R[k + 1] = reac
        ids, values, count = flush(k + 1, mu, family, ci, cj, ids, values, count)
    return X, R, ids[:count], values[:count], work, status, t[K - 1]
