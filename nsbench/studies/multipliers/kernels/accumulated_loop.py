"""Time loop of position-based dynamics with accumulated multipliers: projected Gauss-Seidel.

A projection on constraint k adds m to its accumulated impulse c_k and m grad g_k to the state,

    m = max(-g_k / |grad g_k|^2, least),    least = -c_k or 0,

so that c_k <- max(0, c_k - g_k / |grad g_k|^2) in the first case: what an earlier sweep or the
start gave too much is taken back. In the second a projection only pushes, as that of PBD.
"""

from __future__ import annotations

import numpy as np

from nsbench.compilation.borrowed_arrays import borrowed
from nsbench.compilation.decorators import fused_kernel, njit
from nsbench.dynamics.contacts.kernels.contact_arrays import PAIR, ROW
from nsbench.dynamics.contacts.kernels.impulse_records import flush
from nsbench.solvers.common.kernels.step_code import StepCode, all_finite
from nsbench.solvers.pbd.kernels.loop_result import LoopResult


@fused_kernel
def _push_along_row(r, m, rows, out):
    """Add m times the gradient of the affine row r to out (n,)."""
    for e in range(rows.ptr[r], rows.ptr[r + 1]):
        out[rows.cols[e]] += m * rows.vals[e]


@fused_kernel
def _offset(kind, p, q, c, x, anchors):
    """Return coordinate c of particle p relative to particle or anchor q."""
    return x[p + c] - (x[q + c] if kind == PAIR else anchors[q + c])


@fused_kernel
def _squared_distance(kind, p, q, dim, x, anchors):
    """Return the squared distance of particle p from particle or anchor q."""
    s = 0.0
    for c in range(dim):
        e = _offset(kind, p, q, c, x, anchors)
        s += e * e
    return s


@fused_kernel
def _push_along_distance(kind, p, q, sign, dim, m, r, x, anchors, out):
    """Add m times the gradient at x (n,) of the distance r to out (n,), which may be x.

    The gradient of a distance of zero is the first axis.
    """
    for c in range(dim):
        if r > 0.0:
            e = sign * m * (_offset(kind, p, q, c, x, anchors) / r)
        else:
            e = sign * m if c == 0 else 0.0
        out[p + c] += e
        if kind == PAIR:
            out[q + c] -= e


@fused_kernel
def _correct(k, least, lists, x, rows, b, anchors):
    """Project x (n,) on constraint k; returns m >= least, and whether centres coincide."""
    kind = lists.kind[k]
    p = lists.p[k]
    if kind == ROW:
        g = b[p]
        for e in range(rows.ptr[p], rows.ptr[p + 1]):
            g += rows.vals[e] * x[rows.cols[e]]
        m = max(-g * rows.inv2[p], least)
        if m != 0.0:
            _push_along_row(p, m, rows, x)
        return m, False
    q = lists.q[k]
    sign = lists.sign[k]
    dim = lists.dim[k]
    d = lists.d[k]
    s = _squared_distance(kind, p, q, dim, x, anchors)
    # most pairs carry nothing and are open, and need no square root
    if least == 0.0 and (sign > 0.0) == (s >= d * d):
        return 0.0, False
    r = np.sqrt(s)
    g = sign * (r - d)
    # |grad g|^2 is 2 for a pair, as both particles move
    m = max(-0.5 * g if kind == PAIR else -g, least)
    if m != 0.0:
        _push_along_distance(kind, p, q, sign, dim, m, r, x, anchors, x)
    return m, m != 0.0 and r == 0.0


@fused_kernel
def _start(c, ratio, lists, v, rows, anchors, x):
    """Scale the impulses c (m,) and add them to x (n,), along the gradients at v (n,).

    Returns how many there are.
    """
    pushed = 0
    for k in range(c.size):
        c[k] *= ratio
        if c[k] == 0.0:
            continue
        pushed += 1
        p = lists.p[k]
        kind = lists.kind[k]
        if kind == ROW:
            _push_along_row(p, c[k], rows, x)
            continue
        q = lists.q[k]
        dim = lists.dim[k]
        r = np.sqrt(_squared_distance(kind, p, q, dim, v, anchors))
        _push_along_distance(kind, p, q, lists.sign[k], dim, c[k], r, v, anchors, x)
    return pushed


@fused_kernel
def _sweep(c, is_taken_back, lists, x, rows, b, anchors):
    """Correct the impulses c (m,) once in their order; returns how many changed, and ties."""
    work = 0
    tied = False
    # projected Gauss-Seidel: each correction starts from where the last one left x
    for k in range(c.size):
        least = -c[k] if is_taken_back else 0.0
        m, coincide = _correct(k, least, lists, x, rows, b, anchors)
        tied = tied or coincide
        if m != 0.0:
            work += 1
            c[k] += m  # zero to the bit where all of it is taken back
    return work, tied


@njit(cache=True)
def march(
    f, b_of, a_of, moving, t, substeps, sweeps, is_kept, is_taken_back, x, lists, rows, b, anchors
) -> LoopResult:
    """Integrate from x (n,) by Euler steps, each with a start by kept impulses, and sweeps.

    is_kept: the impulses of a step start the next one, scaled by the ratio of their lengths, else
    zero. is_taken_back: least = -c_k, else 0. The rest as in pbd/kernels/listed_loop.march. An
    application of a kept impulse counts as a projection.
    """
    lists = borrowed(lists)
    rows = borrowed(rows)
    m = lists.kind.size
    X = np.full((t.size, x.size), np.nan)
    R = np.full((t.size, x.size), np.nan)
    x = x.copy()
    reac = np.zeros(x.size)
    v = np.empty(x.size)
    c = np.zeros(m)  # accumulated impulses of the step
    mu = np.zeros(m)  # their sum since the last sample
    ids = np.empty((4 * m + 16, 4), np.int64)
    values = np.empty(4 * m + 16)
    count = 0
    X[0] = x
    R[0] = reac
    work = 0
    code = StepCode.OK
    last = 0.0
    for k in range(t.size - 1):
        h = (t[k + 1] - t[k]) / substeps[k]
        ratio = h / last if is_kept and last > 0.0 else 0.0
        for s in range(substeps[k]):
            now = t[k] + s * h
            f(now, x, v)
            for i in range(x.size):
                x[i] += h * v[i]
                v[i] = x[i]
            if not all_finite(x):
                return LoopResult(
                    X, R, ids[:count], values[:count], work, StepCode.NAN, now, -1, -1
                )
            if moving:
                after = t[k + 1] if s + 1 == substeps[k] else t[k] + (s + 1) * h
                b_of(after, b)
                a_of(after, anchors)
            work += _start(c, ratio, lists, v, rows, anchors, x)
            for _ in range(sweeps):
                done, tied = _sweep(c, is_taken_back, lists, x, rows, b, anchors)
                work += done
                if tied:
                    code = StepCode.TIED
            for e in range(m):
                mu[e] += c[e]
            for i in range(x.size):
                reac[i] += x[i] - v[i]
            last = h
            ratio = 1.0 if is_kept else 0.0
        X[k + 1] = x
        R[k + 1] = reac
        ids, values, count = flush(k + 1, mu, lists.family, lists.i, lists.j, ids, values, count)
    return LoopResult(X, R, ids[:count], values[:count], work, code, t[t.size - 1], -1, -1)
