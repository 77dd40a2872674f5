"""Projection on one constraint, and the sweep over a list of them.

A list of constraints is a tuple of arrays, one entry each, in the order of the sweep:
kind (0 row of A, 1 pair, 2 particle and anchor), p, q (row number; first coordinate of particle i,
of particle j or of the anchor), d (distance), sign, dim. Rows are CSR: ptr, cols, vals and
1/|row|^2.
The projection on an affine row or a distance is exact, along the gradient; it returns the impulse
h lambda = displacement / |grad g|^2 * |grad g| ... that is, the factor mu in  x += mu grad g.
"""

import numpy as np

from nsbench.compilation.decorators import njit


@njit(cache=True, error_model="numpy")
def project_row(r, x, ptr, cols, vals, inv2, b):
    """Exact projection on A_r x + b_r >= 0; returns mu >= 0 with x += mu A_r."""
    g = b[r]
    for e in range(ptr[r], ptr[r + 1]):
        g += vals[e] * x[cols[e]]
    if g >= 0.0:
        return 0.0
    mu = -g * inv2[r]
    for e in range(ptr[r], ptr[r + 1]):
        x[cols[e]] += mu * vals[e]
    return mu


@njit(cache=True, error_model="numpy")
def project_pair(p, q, d, sign, dim, x):
    """Exact projection on sign (|x_i - x_j| - d) >= 0, both particles moved alike; mu = -g / 2.

    Coincident centres have no gradient: they are parted along the first axis (mu is then negative
    to mark it).
    """
    s = 0.0
    for c in range(dim):
        e = x[p + c] - x[q + c]
        s += e * e
    if (sign > 0.0) == (s >= d * d):
        return 0.0
    r = np.sqrt(s)
    g = sign * (r - d)
    if g >= 0.0:
        return 0.0
    mu = -0.5 * g
    if r == 0.0:
        x[p] += mu
        x[q] -= mu
        return -mu
    w = sign * mu / r
    for c in range(dim):
        e = w * (x[p + c] - x[q + c])
        x[p + c] += e
        x[q + c] -= e
    return mu


@njit(cache=True, error_model="numpy")
def project_anchor(p, q, d, sign, dim, x, anchors):
    """Exact projection on sign (|x_i - a| - d) >= 0; mu = -g."""
    s = 0.0
    for c in range(dim):
        e = x[p + c] - anchors[q + c]
        s += e * e
    r = np.sqrt(s)
    g = sign * (r - d)
    if g >= 0.0:
        return 0.0
    if r == 0.0:
        x[p] -= g
        return g
    w = -sign * g / r
    for c in range(dim):
        x[p + c] += w * (x[p + c] - anchors[q + c])
    return -g


@njit(cache=True, error_model="numpy")
def sweep(lo, hi, step, kind, p, q, d, sign, dim, x, ptr, cols, vals, inv2, b, anchors, mu):
    """Project once on the constraints lo, lo + step, ... before hi; mu[c] grows by the impulse of
    c.

    Returns the number of projections done and whether coincident centres were met.
    """
    work = 0
    tied = False
    c = lo
    while c != hi:
        if kind[c] == 0:
            m = project_row(p[c], x, ptr, cols, vals, inv2, b)
        elif kind[c] == 1:
            m = project_pair(p[c], q[c], d[c], sign[c], dim[c], x)
        else:
            m = project_anchor(p[c], q[c], d[c], sign[c], dim[c], x, anchors)
        if m != 0.0:
            work += 1
            if m < 0.0:
                tied = True
                m = -m
            mu[c] += m
        c += step
    return work, tied
