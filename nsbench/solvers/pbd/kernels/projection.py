"""Projection on one constraint, and one Gauss-Seidel sweep over a list of them.

The projection on an affine row or a distance is exact, along the gradient:

    x += mu grad g,    mu = max(0, -g) / |grad g|^2,

so that g(x) = 0 afterwards if it was negative (for a distance grad g keeps its direction). mu is
the impulse h lambda of the step.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from nsbench.compilation.borrowed_arrays import borrowed
from nsbench.compilation.decorators import fused_kernel, njit
from nsbench.dynamics.contacts.kernels.contact_arrays import PAIR, ROW

if TYPE_CHECKING:
    from nsbench.dynamics.contacts.kernels.contact_arrays import AffineRows, ListedContacts


@fused_kernel
def project_row(r: int, x: np.ndarray, rows: AffineRows, b: np.ndarray) -> float:
    """Project x (n,) on A_r x + b_r >= 0; returns mu >= 0 with x += mu A_r; b (rows,)."""
    g = b[r]
    for e in range(rows.ptr[r], rows.ptr[r + 1]):
        g += rows.vals[e] * x[rows.cols[e]]
    if g >= 0.0:
        return 0.0
    mu = -g * rows.inv2[r]
    for e in range(rows.ptr[r], rows.ptr[r + 1]):
        x[rows.cols[e]] += mu * rows.vals[e]
    return mu


@fused_kernel
def project_pair(p: int, q: int, d: float, sign: float, dim: int, x: np.ndarray) -> float:
    """Project on sign (|x_i - x_j| - d) >= 0, both particles moved alike; returns mu = -g / 2.

    p, q: first coordinates of particles i, j in x (n,). Coincident centres have no gradient: they
    are parted along the first axis, and mu is returned negative to mark it.
    """
    # squared distances decide first: most pairs need no square root
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


@fused_kernel
def project_anchor(
    p: int, q: int, d: float, sign: float, dim: int, x: np.ndarray, anchors: np.ndarray
) -> float:
    """Project on sign (|x_i - a| - d) >= 0; returns mu = -g, negative for coincident centres.

    p, q: first coordinates of particle i in x (n,) and of the anchor a in anchors.
    """
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


@fused_kernel
def project(
    kind: int,
    p: int,
    q: int,
    d: float,
    sign: float,
    dim: int,
    x: np.ndarray,
    rows: AffineRows,
    b: np.ndarray,
    anchors: np.ndarray,
) -> float:
    """Project x (n,) on a constraint, given as Contacts hold it; returns mu as those above."""
    if kind == ROW:
        return project_row(p, x, rows, b)
    if kind == PAIR:
        return project_pair(p, q, d, sign, dim, x)
    return project_anchor(p, q, d, sign, dim, x, anchors)


@njit(cache=True, error_model="numpy")
def sweep(
    lo: int,
    hi: int,
    lists: ListedContacts,
    x: np.ndarray,
    rows: AffineRows,
    b: np.ndarray,
    anchors: np.ndarray,
    mu: np.ndarray,
) -> tuple[int, bool]:
    """Project x (n,) once on the constraints lo, ..., hi - 1; mu[c], mu (m,), grows by the impulse
    of c.

    lists: ListedContacts; rows: AffineRows; b, anchors: constants of the rows, coordinates of the
    anchors. Returns the number of projections done and whether coincident centres were met.
    """
    lists = borrowed(lists)
    rows = borrowed(rows)
    work = 0
    tied = False
    _, _, _, _, p, q, d, sign, dim = lists
    kind = lists.kind
    # Gauss-Seidel sweep: each projection starts from where the last one left x.
    for c in range(lo, hi):
        m = project(kind[c], p[c], q[c], d[c], sign[c], dim[c], x, rows, b, anchors)
        if m != 0.0:
            work += 1
            if m < 0.0:
                tied = True
                m = -m
            mu[c] += m
    return work, tied
