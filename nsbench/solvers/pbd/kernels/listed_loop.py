"""Time loop of position-based dynamics over listed constraints: Euler, then sweeps."""

from __future__ import annotations

import numpy as np

from nsbench.compilation.borrowed_arrays import borrowed
from nsbench.compilation.decorators import njit
from nsbench.dynamics.contacts.kernels.impulse_records import flush
from nsbench.solvers.common.kernels.step_code import StepCode, all_finite
from nsbench.solvers.pbd.kernels.loop_result import LoopResult
from nsbench.solvers.pbd.kernels.projection import sweep


@njit(cache=True)
def march(f, b_of, a_of, moving, t, substeps, sweeps, x, lists, rows, b, anchors) -> LoopResult:
    """Integrate from x (n,), projecting on the constraints in the order of `lists`.

    f, b_of, a_of: pointers (t, x, out), (t, out), (t, out); moving: whether the last two depend on
    t; t (K,), substeps (K - 1,): the grid; lists: ListedContacts; rows: AffineRows. Returns a
    LoopResult.
    """
    lists = borrowed(lists)
    rows = borrowed(rows)
    K = t.size
    m = lists.kind.size
    X = np.full((K, x.size), np.nan)
    R = np.full((K, x.size), np.nan)
    x = x.copy()
    reac = np.zeros(x.size)
    v = np.empty(x.size)
    mu = np.zeros(m)
    ids = np.empty((4 * m + 16, 4), np.int64)
    values = np.empty(4 * m + 16)
    count = 0
    X[0] = x
    R[0] = reac
    work = 0
    code = StepCode.OK
    # position-based dynamics: an Euler step, then Gauss-Seidel sweeps of projections
    for k in range(K - 1):
        h = (t[k + 1] - t[k]) / substeps[k]
        for s in range(substeps[k]):
            now = t[k] + s * h
            # explicit Euler; v is then the state before the projections
            f(now, x, v)
            for c in range(x.size):
                x[c] += h * v[c]
                v[c] = x[c]
            if not all_finite(x):
                return LoopResult(
                    X, R, ids[:count], values[:count], work, StepCode.NAN, now, -1, -1
                )
            if moving:
                after = t[k + 1] if s + 1 == substeps[k] else t[k] + (s + 1) * h
                b_of(after, b)
                a_of(after, anchors)
            for _ in range(sweeps):
                done, tied = sweep(0, m, lists, x, rows, b, anchors, mu)
                work += done
                if tied:
                    code = StepCode.TIED
            for c in range(x.size):
                reac[c] += x[c] - v[c]
        X[k + 1] = x
        R[k + 1] = reac
        ids, values, count = flush(k + 1, mu, lists.family, lists.i, lists.j, ids, values, count)
    return LoopResult(X, R, ids[:count], values[:count], work, code, t[K - 1], -1, -1)
