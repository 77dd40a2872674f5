"""The first event on a step of which the path is known as Taylor series: gaps that close,
multipliers that vanish.

Entries that the path cannot bring to zero within the step are left out by a bound on how far each
coordinate travels;
of the others the gap is developed into a series and its descents are isolated (see descents).
Nothing is sampled.
"""

import numpy as np

from nsbench.compilation.decorators import inlined, inner_kernel, one
from nsbench.solvers.event_driven.contacts.kernels.polynomial_descent import next_crossing


@inner_kernel
def displacement_bound(X, deg, h, first, out):
    """out (n,): a bound on how far each coordinate goes within h by the terms of order `first` and
    higher."""
    for i in range(out.size):
        out[i] = 0.0
    for j in range(deg, first - 1, -1):
        for i in range(out.size):
            out[i] = (out[i] + abs(X[j, i])) * (h if j > first else 1.0)
    for i in range(out.size):
        out[i] *= h**first


@inner_kernel
def leaves_list_certificate(x, origin, reach, hard, limit):
    """(may, did): whether a hard particle may go farther than `limit` from its origin in this step;
    whether any moved."""
    may = False
    did = False
    for f in range(hard.shape[0]):
        for i in range(hard[f, 1]):
            s = 0.0
            r = 0.0
            for c in range(hard[f, 2]):
                k = hard[f, 0] + i * hard[f, 2] + c
                s += (x[k] - origin[k]) ** 2
                r += reach[k] ** 2
            did |= s > 0.0
            may |= np.sqrt(s) + np.sqrt(r) > limit
    return may, did


@inner_kernel
def _possible_events(held, armed, listed, places, X, h, bend):
    """Entries not held that may reach zero within h, and those not armed.

    The others stay above zero along the straight line, by more than both ends may bend off it.
    """
    kind, p, q, d, sign, dim = listed
    anchors, ptr, cols, vals, b = places
    out = np.empty(kind.size, np.int64)
    m = 0
    for k in range(kind.size):
        if held[k]:
            continue
        if not armed[k]:
            far = False
        elif kind[k] == 0:
            g = b[p[k]]
            v = 0.0
            r = 0.0
            for e in range(ptr[p[k]], ptr[p[k] + 1]):
                g += vals[e] * X[0, cols[e]]
                v += vals[e] * X[1, cols[e]]
                r += abs(vals[e]) * bend[cols[e]]
            far = min(g, g + v * h) > r
        else:
            s = 0.0
            sv = 0.0
            vv = 0.0
            r = 0.0
            for c in range(dim[k]):
                i = p[k] + c
                j = q[k] + c
                if kind[k] == 1:
                    u = X[0, i] - X[0, j]
                    v = (X[1, i] - X[1, j]) * h
                    w = bend[i] + bend[j]
                else:
                    u = X[0, i] - anchors[j]
                    v = X[1, i] * h
                    w = bend[i]
                s += u * u
                sv += u * v
                vv += v * v
                r += w * w
            r = np.sqrt(r)
            if sign[k] < 0.0:
                far = d[k] > r and max(s, s + 2.0 * sv + vv) < (d[k] - r) * (d[k] - r)
            else:
                if sv + vv <= 0.0:
                    s += 2.0 * sv + vv  # nearest at the end
                elif sv < 0.0:
                    s -= sv * sv / vv * (1.0 + 1e-12)
                far = s > (d[k] + r) * (d[k] + r)
        if not far:
            out[m] = k
            m += 1
    return out[:m]


@inner_kernel
def _gap_series(k, listed, places, X, deg, powers, diff, out):
    """out (deg + 1,): series of the gap (see series.gap) in the time over h."""
    kind, p, q, d, sign, dim = listed
    anchors, ptr, cols, vals, b = places
    out[: deg + 1] = 0.0
    if kind[k] == 0:
        out[0] = b[p[k]]
        for j in range(deg + 1):
            for e in range(ptr[p[k]], ptr[p[k] + 1]):
                out[j] += vals[e] * X[j, cols[e]] * powers[j]
        return
    for c in range(dim[k]):
        for j in range(deg + 1):
            diff[j] = (X[j, p[k] + c] - (X[j, q[k] + c] if kind[k] == 1 else 0.0)) * powers[j]
        if kind[k] == 2:
            diff[0] -= anchors[q[k] + c]
        for j in range(deg + 1):
            s = 0.0
            for a in range(j + 1):
                s += diff[a] * diff[j - a]
            out[j] += s
    out[0] -= d[k] * d[k]
    for j in range(deg + 1):
        out[j] *= 0.5 * sign[k] / d[k]


@inlined
def first_event(
    W, held, listed, places, norm, X, mu, deg, h, band, level, armed, firm, low, small, bend
):
    """(s, entry, touches): the first event at s h, 0 <= s <= 1, its entry in the list; s = 2.0 if
    there is none.

    band, level, armed (m,) of gaps; firm, low (p,): armed and level of multipliers, whose band is
    `small` over norm; bend (n,): how far coordinates go by the terms of order two and higher. armed
    and firm become those at the end of the step.
    """
    kind, _, _, _, sign, _ = listed
    powers = np.empty(deg + 1)
    diff = np.empty(deg + 1)
    b = np.empty(deg + 1)
    c = np.empty(deg + 1)
    e = np.empty(deg + 1)
    powers[0] = 1.0
    for j in range(deg):
        powers[j + 1] = powers[j] * h
    best = 2.0
    which = -one()
    touches = 0
    hi = 1.0
    for k in _possible_events(held, armed, listed, places, X, h, bend):
        _gap_series(k, listed, places, X, deg, powers, diff, c)
        s, now, touched = next_crossing(
            c, deg, armed[k], level[k], band[k], 0.05 * band[k], hi, b, e
        )
        armed[k] = now
        touches += touched
        if s >= 0.0 and s < best:
            best = s
            hi = s
            which = k
    for a in range(W.size):
        k = W[a]
        turn = sign[k] if kind[k] > 0 else 1.0
        for j in range(deg):
            c[j] = turn * mu[a, j] * powers[j]
        tight = small / norm[k]
        s, now, touched = next_crossing(c, deg - 1, firm[a], low[a], tight, 0.05 * tight, hi, b, e)
        firm[a] = now
        touches += touched
        if s >= 0.0 and s < best:
            best = s
            hi = s
            which = k
    return best, which, touches
