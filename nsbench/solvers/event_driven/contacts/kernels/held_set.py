"""What an arc with a set of held contacts needs: rows, plan, factor; and questions to that
factor."""

import numpy as np

from nsbench.compilation.decorators import inner_kernel
from nsbench.linalg.skyline_cholesky import arrange, solve
from nsbench.solvers.event_driven.contacts.kernels.taylor_flow import (
    project_and_factor,
    sorted_index,
)

# pivots over their diagonal that count as zero: contacts that lock or depend on each other
LEAST = 1e-12


@inner_kernel
def build_held_set(W, listed, places, norm, x, width, order, work, unit):
    """Everything an arc with the held entries W needs, with x put on them; and whether that could
    be done."""
    p = W.size
    C = np.empty((p, width), np.int64)
    V = np.empty((p, width))
    count = np.zeros(p, np.int64)
    # orders are written before they are read
    U = np.empty((p, 3, order + 2))
    mu = np.empty((p, order + 1))
    kind, first, _, _, _, dim = listed
    second = listed[2]
    ptr = places[1]
    cols = places[2]
    for a in range(p):  # the pattern alone, for the plan
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
    gear = (C, V, count, U, mu, plan, np.empty(plan[2][p]))
    return project_and_factor(W, gear, listed, places, norm, x, work, LEAST, unit), gear


@inner_kernel
def gap_rate(k, listed, places, x, v):
    """(G_k v, |G_k|^2) of entry k."""
    kind, p, q, d, sign, dim = listed
    anchors, ptr, cols, vals, _ = places
    s = 0.0
    size = 0.0
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


@inner_kernel
def _push(gear, W, z, n):
    """G^T z."""
    C = gear[0]
    V = gear[1]
    count = gear[2]
    out = np.zeros(n)
    for a in range(W.size):
        for e in range(count[a]):
            out[C[a, e]] += z[a] * V[a, e]
    return out


@inner_kernel
def column(entry, W, gear, n):
    """G^T z / sqrt(z_k) and z_k for the column z = M^-1 e_k of `entry`."""
    z = np.zeros(W.size)
    k = sorted_index(W, entry)
    z[k] = 1.0
    solve(gear[5], W.size, gear[6], z, z)
    top = z[k]
    for a in range(W.size):
        z[a] /= np.sqrt(top)
    return _push(gear, W, z, n), top


@inner_kernel
def toggled(W, entry, change):
    """W with the entry put in (change 1) or taken out (-1); sorted."""
    out = np.empty(W.size + change, np.int64)
    a = sorted_index(W, entry)
    for i in range(a):
        out[i] = W[i]
    if change > 0:
        out[a] = entry
    for i in range(a if change > 0 else a + 1, W.size):
        out[i + change] = W[i]
    return out


@inner_kernel
def squared_sine_to_span(c, W, gear, listed, places, x):
    """Squared sine of the angle between the gradient of entry c and the span of those held."""
    C = gear[0]
    V = gear[1]
    count = gear[2]
    row = gradient(c, listed, places, x)
    r = np.empty(W.size)
    size = 0.0
    rest = 0.0
    for i in range(row.size):
        size += row[i] * row[i]
    for _ in range(2):  # once more on the rest: the difference of two lengths is no length
        for a in range(W.size):
            r[a] = 0.0
            for e in range(count[a]):
                r[a] += V[a, e] * row[C[a, e]]
        solve(gear[5], W.size, gear[6], r, r)
        for a in range(W.size):
            for e in range(count[a]):
                row[C[a, e]] -= V[a, e] * r[a]
    for i in range(row.size):
        rest += row[i] * row[i]
    return rest / size


@inner_kernel
def gradient(k, listed, places, x):
    """(n,) the gradient of entry k, dense; distances up to their sign."""
    kind, p, q, d, _, dim = listed
    anchors, ptr, cols, vals, _ = places
    row = np.zeros(x.size)
    if kind[k] == 0:
        for e in range(ptr[p[k]], ptr[p[k] + 1]):
            row[cols[e]] += vals[e]
        return row
    for c in range(dim[k]):
        u = (x[p[k] + c] - (x[q[k] + c] if kind[k] == 1 else anchors[q[k] + c])) / d[k]
        row[p[k] + c] = u
        if kind[k] == 1:
            row[q[k] + c] = -u
    return row
