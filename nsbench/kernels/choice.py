"""The next set of held contacts after one event, where it is beyond doubt: else nothing is decided here.

The set is that before with the contact that closed, without the one whose multiplier vanished, and without those whose
multipliers are then negative. It is taken if every multiplier of it is strictly positive and every other closed contact
opens strictly: with independent gradients that solves the complementarity problem of velocities, and nothing else does.
Closed contacts that depended on the set before must still do so.
"""
import numpy as np
from numba import njit

from nsbench.kernels.series import extend, gap, hold
from nsbench.kernels.skyline import arrange, solve

T, END, TOL, EPS, SIZE, MAX_STEP, BOX, REACH, H, DOUBT, STRICT, DEPENDENT, NUM = range(13)     # entries of `num`
LEAST = 1e-12           # pivots over their diagonal that count as zero: contacts that lock or depend on each other
DROPS = 8               # multipliers that may vanish with one event here


@njit(cache=True, error_model="numpy")
def outfit(W, listed, places, norm, x, width, order, work):
    """Everything an arc with the held entries W needs, with x put on them; and whether that could be done."""
    p = W.size
    C, V, count = np.zeros((p, width), np.int64), np.zeros((p, width)), np.zeros(p, np.int64)
    U, mu = np.zeros((p, 3, order + 2)), np.zeros((p, order + 1))
    kind, first, _, _, _, dim = listed
    second, ptr, cols = listed[2], places[1], places[2]
    for a in range(p):                                    # the pattern alone, for the plan
        k = W[a]
        if kind[k] == 0:
            for e in range(ptr[first[k]], ptr[first[k] + 1]):
                C[a, count[a]] = cols[e]
                count[a] += 1
        else:
            for c in range(dim[k]):
                C[a, c] = first[k] + c
                if kind[k] == 1:
                    C[a, dim[k] + c] = second[k] + c
            count[a] = 2 * dim[k] if kind[k] == 1 else dim[k]
    plan = arrange(C, count, p, x.size)
    E = np.empty(plan[2][p])
    good = hold(W, plan, listed, places, norm, x, C, V, count, U, E, work, LEAST)
    return good, (C, V, count, U, mu, plan, E)


@njit(cache=True, error_model="numpy")
def speed(k, listed, places, x, v):
    """(G_k v, |G_k|^2) of entry k."""
    kind, p, q, d, sign, dim = listed
    anchors, ptr, cols, vals, _ = places
    s, size = 0.0, 0.0
    if kind[k] == 0:
        for e in range(ptr[p[k]], ptr[p[k] + 1]):
            s += vals[e] * v[cols[e]]
            size += vals[e] * vals[e]
        return s, size
    for c in range(dim[k]):
        u = (x[p[k] + c] - (x[q[k] + c] if kind[k] == 1 else anchors[q[k] + c])) / d[k]
        s += u * (v[p[k] + c] - (v[q[k] + c] if kind[k] == 1 else 0.0))
        size += u * u
    return sign[k] * s, size * (2.0 if kind[k] == 1 else 1.0)


@njit(cache=True, error_model="numpy")
def _push(gear, W, z, n):
    """G^T z."""
    C, V, count = gear[0], gear[1], gear[2]
    out = np.zeros(n)
    for a in range(W.size):
        for e in range(count[a]):
            out[C[a, e]] += z[a] * V[a, e]
    return out


@njit(cache=True, error_model="numpy")
def _column(entry, W, gear, n):
    """G^T z / sqrt(z_k) and z_k for the column z = M^-1 e_k of `entry`."""
    z, k = np.zeros(W.size), np.searchsorted(W, entry)
    z[k] = 1.0
    solve(gear[5], W.size, gear[6], z, z)
    top = z[k]
    for a in range(W.size):
        z[a] /= np.sqrt(top)
    return _push(gear, W, z, n), top


@njit(cache=True, error_model="numpy")
def _switched(W, entry, closing):
    """W with the entry put in or taken out; sorted."""
    at_ = np.searchsorted(W, entry)
    out = np.empty(W.size + (1 if closing else -1), np.int64)
    out[:at_] = W[:at_]
    if closing:
        out[at_] = entry
        out[at_ + 1:] = W[at_:]
    else:
        out[at_:] = W[at_ + 1:]
    return out


@njit(cache=True, error_model="numpy")
def _wanted(W, gear, listed, norm, small):
    """Index of the member whose multiplier is smallest, if that is not above `small`; -1 if all are; -2 if one is no number."""
    kind, sign = listed[0], listed[4]
    worst, which = small, -1
    for a in range(W.size):
        lam = (sign[W[a]] if kind[W[a]] > 0 else 1.0) * gear[4][a, 0] * norm[W[a]]
        if not np.isfinite(lam):
            return -2
        if lam <= worst:
            worst, which = lam, a
    return which


@njit(cache=True, error_model="numpy")
def _leaves(entry, W, gear, kept, listed, places, x, dependent):
    """Whether every closed contact that depends on W does so without `entry`; and the entry of the inverse Gram matrix.

    With z the column of that inverse, G_c G^T z is the coefficient of `entry` in row c.
    """
    pull, top = _column(entry, W, gear, x.size)
    held = 0
    for k in range(kept.size):
        if held < W.size and W[held] == k:
            held += 1
        elif kept[k]:
            y, size = speed(k, listed, places, x, pull)
            if y * y > 1e-2 * dependent * size:
                return False, top
    return True, top


@njit(cache=True, error_model="numpy")
def _opens(entry, fade, dropped, W, kept, listed, places, norm, x, v, num, pace):
    """Whether every closed contact outside W opens strictly, or depends on W as before.

    entry: the one whose multiplier vanished, opening with acceleration `fade`; -1 if one closed.
    """
    near, small, held = num[TOL] * (1.0 + np.abs(x).max()), num[DOUBT] * num[SIZE], 0
    for k in range(kept.size):
        if held < W.size and W[held] == k:
            held += 1
            continue
        g = gap(k, listed, places, x)
        if k == entry:
            if not fade * 1e-5 * pace > 1e2 * num[STRICT] * num[SIZE]:      # 1e-5: the first look ahead
                return False
        elif kept[k] and not dropped[k]:
            if g > near * norm[k]:
                return False
        elif dropped[k] or g <= near * norm[k]:
            w, _ = speed(k, listed, places, x, v)
            if not w > small * norm[k]:
                return False
    return True


@njit(cache=True, error_model="numpy")
def choose(entry, closing, slope, W, gear, kept, listed, places, norm, drift, width, order, x, X, F, work, num, pace):
    """(sure, set, gear, dropped): the next set and all for its arc, with mu and X of order 0; x is put on it.

    entry: what closed, or vanished with that `slope` of its multiplier, of the set W with its gear; kept (m,): closed
    contacts that are held or depend on those; pace: a step of the integrator; dropped (m,): what has left the set.
    """
    dropped, fade, full = np.zeros(kept.size, np.bool_), 0.0, closing
    if not closing:
        free, top = _leaves(entry, W, gear, kept, listed, places, x, num[DEPENDENT])
        dropped[entry], fade = True, -slope / top
        if not free:
            return False, W, gear, dropped
    W2, start = _switched(W, entry, closing), x.copy()
    for _ in range(DROPS):
        x[:] = start
        good, gear2 = outfit(W2, listed, places, norm, x, width, order, work)
        if not good:
            return False, W, gear, dropped
        X[0] = x
        extend(0, 1, W2, gear2[5], gear2[6], listed, drift, gear2[0], gear2[1], gear2[2], gear2[3], gear2[4], X, F,
               np.empty(W2.size))
        num[SIZE] = max(num[SIZE], np.abs(F[0]).max())
        if full:
            full = False
            _, top = _column(entry, W2, gear2, x.size)
            _, size = speed(entry, listed, places, x, X[1])
            if not 1.0 > 10.0 * num[DEPENDENT] * top * size:          # squared sine to the others
                return False, W, gear, dropped
        a = _wanted(W2, gear2, listed, norm, num[DOUBT] * num[SIZE])
        if a == -1:
            sure = _opens(-1 if closing else entry, fade, dropped, W2, kept, listed, places, norm, x, X[1], num, pace)
            return sure, W2, gear2, dropped
        if a < 0 or (closing and W2[a] == entry):
            return False, W, gear, dropped
        free, _ = _leaves(W2[a], W2, gear2, kept, listed, places, x, num[DEPENDENT])
        if not free:
            return False, W, gear, dropped
        dropped[W2[a]] = True
        W2 = _switched(W2, W2[a], False)
    return False, W, gear, dropped
