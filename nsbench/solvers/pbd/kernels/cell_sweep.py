"""One sweep over hard particles stored by cells and rows on single ones, under a certificate
(kernels.pbd_packed)."""

import numpy as np

from nsbench.compilation.decorators import njit


@njit(cache=True, error_model="numpy")
def project_row(y, s, q, rows, b, dim):
    """Projection of particle s on row q, as kernels.project.project_row; returns mu."""
    ptr, cols, vals, inv2 = rows
    g = b[q]
    for e in range(ptr[q], ptr[q + 1]):
        g += vals[e] * y[s * dim + cols[e] % dim]
    if g >= 0.0:
        return 0.0
    mu = -g * inv2[q]
    for e in range(ptr[q], ptr[q + 1]):
        y[s * dim + cols[e] % dim] += mu * vals[e]
    return mu


@njit(cache=True, error_model="numpy")
def strayed(y, base, s, dim, limit2):
    """Whether particle s is farther than sqrt(limit2) from where the list was made."""
    far = 0.0
    for c in range(s * dim, (s + 1) * dim):
        e = y[c] - base[c]
        far += e * e
    return far > limit2


@njit(cache=True, error_model="numpy")
def project_pair(y, p, q, d, dim):
    """kernels.project.project_pair in any dimension, for sign + 1; returns mu, negative where
    centres coincide."""
    s = 0.0
    for c in range(dim):
        e = y[p * dim + c] - y[q * dim + c]
        s += e * e
    if s >= d * d:
        return 0.0
    r = np.sqrt(s)
    if r >= d:
        return 0.0
    mu = -0.5 * (r - d)
    if r == 0.0:
        y[p * dim] += mu
        y[q * dim] -= mu
        return -mu
    w = mu / r
    for c in range(dim):
        e = w * (y[p * dim + c] - y[q * dim + c])
        y[p * dim + c] += e
        y[q * dim + c] -= e
    return mu


@njit(cache=True, error_model="numpy")
def sweep(lists, y, base, r, dim, rows, b, limit2, log_at, log_mu, record):
    """Project on all candidates in the order given; impulses before each are logged.

    Returns the projections done, whether centres coincided, and whether a particle strayed (the
    sweep then ends).
    """
    if dim == 2 and r.size == 1:
        return sweep_discs(lists, y, base, 2.0 * r[0], rows, b, limit2, log_at, log_mu, record)
    i, j, mu = lists
    k = 0
    tied = False
    for c in range(i.size):
        p = i[c]
        q = j[c]
        if q >= 0:
            m = project_pair(y, p, q, 2.0 * r[0] if r.size == 1 else r[p] + r[q], dim)
        else:
            m = project_row(y, p, -1 - q, rows, b, dim)
        if m == 0.0:
            continue
        tied = tied or m < 0.0
        if record:
            log_at[k] = c
            log_mu[k] = mu[c]
            mu[c] += abs(m)
        k += 1
        if strayed(y, base, p, dim, limit2) or (q >= 0 and strayed(y, base, q, dim, limit2)):
            return k, tied, True
    return k, tied, False


@njit(cache=True, error_model="numpy")
def sweep_discs(lists, y, base, d, rows, b, limit2, log_at, log_mu, record):
    """`sweep` in the plane for one diameter d. Indices are unsigned: numba then does not ask
    whether they count from the end, which would be a fourth of the time."""
    i, j, mu = lists
    one = np.uint64(1)
    two = np.uint64(2)
    k = np.uint64(0)
    d2 = d * d
    tied = False
    for c in range(i.size):
        if j[c] < 0:
            m = project_row(y, i[c], -1 - j[c], rows, b, 2)
            if m == 0.0:
                continue
            broken = strayed(y, base, i[c], 2, limit2)
        else:
            p = two * np.uint64(i[c])
            q = two * np.uint64(j[c])
            ex = y[p] - y[q]
            ey = y[p + one] - y[q + one]
            s = ex * ex + ey * ey
            if s >= d2:
                continue
            length = np.sqrt(s)
            m = -0.5 * (length - d)
            if m <= 0.0:
                continue
            if length == 0.0:
                ex = m
                tied = True
            else:
                w = m / length
                ex = w * ex
                ey = w * ey
            px = y[p] + ex
            py = y[p + one] + ey
            qx = y[q] - ex
            qy = y[q + one] - ey
            y[p] = px
            y[p + one] = py
            y[q] = qx
            y[q + one] = qy
            px = px - base[p]
            py = py - base[p + one]
            qx = qx - base[q]
            qy = qy - base[q + one]
            broken = max(px * px + py * py, qx * qx + qy * qy) > limit2
        if record:
            log_at[k] = c
            log_mu[k] = mu[c]
            mu[c] += m
        k += one
        if broken:
            return np.int64(k), tied, True
    return np.int64(k), tied, False
