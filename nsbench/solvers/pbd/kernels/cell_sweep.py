"""One step over hard particles stored by cells: drift, sweep of projections, reaction.

Positions y are in the order of the store, positions x and the drift v by label. The sweep projects
on the active candidates in their order of execution and stops where a particle has moved farther
than its certificate allows (see cell_loop); the projections are those of kernels/projection.py,
once more in a form that knows the store: in any dimension, and for equal discs in the plane.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from nsbench.compilation.decorators import fused_kernel, inner_kernel

if TYPE_CHECKING:
    from nsbench.dynamics.contacts.kernels.contact_arrays import AffineRows
    from nsbench.solvers.pbd.kernels.cell_storage import PairImpulses


@fused_kernel
def drift(
    x: np.ndarray,
    y: np.ndarray,
    spot: np.ndarray,
    v: np.ndarray,
    label: np.ndarray,
    h: float,
    dim: int,
) -> float:
    """Fill y (n dim,) with one step of explicit Euler from x (n dim,), v (n dim,) the drift there.

    y and spot, the places to measure from, are in the order of the store, x and v by label; label
    (n,): of each place of the store; h: step.
    Returns the largest squared distance of a particle from spot, NaN if not all is finite.
    """
    far = 0.0
    good = True
    # explicit Euler, and in the same pass how far each particle has come
    for s in range(label.size):
        g = 0.0
        for c in range(dim):
            a = x[label[s] * dim + c] + h * v[label[s] * dim + c]
            y[s * dim + c] = a
            good = good and abs(a) < 1e150  # its square is finite
            g += (a - spot[s * dim + c]) ** 2
        far = max(far, g)
    return far if good else np.nan


@inner_kernel
def farthest(y: np.ndarray, base: np.ndarray, dim: int, n: int) -> float:
    """Return the largest squared distance of n particles y (n dim,) from base (n dim,)."""
    far = 0.0
    for s in range(n):
        g = 0.0
        for c in range(s * dim, (s + 1) * dim):
            g += (y[c] - base[c]) ** 2
        far = max(far, g)
    return far


@fused_kernel
def settle(
    x: np.ndarray,
    y: np.ndarray,
    v: np.ndarray,
    reac: np.ndarray,
    label: np.ndarray,
    h: float,
    dim: int,
) -> None:
    """Add the displacement by the sweep to the reaction, and bring x from before the step to y.

    x, v (n dim,): by label; y, reac (n dim,): in the order of the store; label (n,).
    """
    for s in range(label.size):
        for c in range(dim):
            e = label[s] * dim + c
            reac[s * dim + c] += y[s * dim + c] - (x[e] + h * v[e])
            x[e] = y[s * dim + c]


@fused_kernel
def project_stored_row(
    y: np.ndarray, s: int, q: int, rows: AffineRows, b: np.ndarray, dim: int
) -> float:
    """Project particle s of y (n dim,) on row q, as projection.project_row; returns mu."""
    g = b[q]
    for e in range(rows.ptr[q], rows.ptr[q + 1]):
        g += rows.vals[e] * y[s * dim + rows.cols[e] % dim]
    if g >= 0.0:
        return 0.0
    mu = -g * rows.inv2[q]
    for e in range(rows.ptr[q], rows.ptr[q + 1]):
        y[s * dim + rows.cols[e] % dim] += mu * rows.vals[e]
    return mu


@fused_kernel
def is_stored_beyond(y: np.ndarray, base: np.ndarray, s: int, dim: int, limit2: float) -> bool:
    """Return whether particle s of y (n dim,) is farther than sqrt(limit2) from its place in
    base."""
    far = 0.0
    for c in range(s * dim, (s + 1) * dim):
        e = y[c] - base[c]
        far += e * e
    return far > limit2


@fused_kernel
def project_stored_pair(y: np.ndarray, p: int, q: int, d: float, dim: int) -> float:
    """Project particles p, q of y (n dim,) on |x_p - x_q| >= d.

    Returns mu, half the overlap, negative where centres coincide.
    """
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
    if r == 0.0:  # no normal: apart along the first axis
        y[p * dim] += mu
        y[q * dim] -= mu
        return -mu
    w = mu / r
    for c in range(dim):
        e = w * (y[p * dim + c] - y[q * dim + c])
        y[p * dim + c] += e
        y[q * dim + c] -= e
    return mu


@fused_kernel
def sweep_stored(
    active: PairImpulses,
    y: np.ndarray,
    base: np.ndarray,
    r: np.ndarray,
    dim: int,
    rows: AffineRows,
    b: np.ndarray,
    limit2: float,
    log_at: np.ndarray,
    log_mu: np.ndarray,
    record: bool,
) -> tuple[int, bool, bool]:
    """Project once on each active candidate in the order given.

    active: PairImpulses (i, j, mu), j < 0 for row -1 - j on particle i; mu grows by the impulses if
    they are recorded, and its values before are logged in log_at, log_mu. r: radii, (n,) or (1,).
    Returns the projections done, whether centres coincided, and whether a particle went farther
    than sqrt(limit2) from base: the sweep then ends there.
    """
    if dim == 2 and r.size == 1:
        return sweep_discs(active, y, base, 2.0 * r[0], rows, b, limit2, log_at, log_mu, record)
    k = 0
    tied = False
    # Gauss-Seidel sweep: each projection starts from the positions that the last one left
    for c in range(active.i.size):
        p = active.i[c]
        q = active.j[c]
        if q >= 0:
            m = project_stored_pair(y, p, q, 2.0 * r[0] if r.size == 1 else r[p] + r[q], dim)
        else:
            m = project_stored_row(y, p, -1 - q, rows, b, dim)
        if m == 0.0:
            continue
        tied = tied or m < 0.0
        if record:
            log_at[k] = c
            log_mu[k] = active.mu[c]
            active.mu[c] += abs(m)
        k += 1
        if is_stored_beyond(y, base, p, dim, limit2) or (
            q >= 0 and is_stored_beyond(y, base, q, dim, limit2)
        ):
            return k, tied, True
    return k, tied, False


@fused_kernel
def sweep_discs(
    active: PairImpulses, y, base, d, rows, b, limit2, log_at, log_mu, record
) -> tuple[int, bool, bool]:
    """Do the sweep in the plane for one diameter d; y, base (2 n,): positions.

    Indices are unsigned: numba then does not test whether they count from the end, which would be a
    fourth of the time.
    """
    i, j, mu = active
    one = np.uint64(1)
    two = np.uint64(2)
    k = np.uint64(0)
    d2 = d * d
    tied = False
    for c in range(i.size):
        if j[c] < 0:
            m = project_stored_row(y, i[c], -1 - j[c], rows, b, 2)
            if m == 0.0:
                continue
            broken = is_stored_beyond(y, base, i[c], 2, limit2)
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
            if length == 0.0:  # no normal: apart along the first axis
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
