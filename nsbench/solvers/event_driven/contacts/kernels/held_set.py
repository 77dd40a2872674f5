"""Cholesky factor of the Gram matrix of the active contacts, and its use on single gradients.

Active contacts have G x' = 0. The multipliers solve (G G^T) mu = rhs, so an arc needs the rows of
G, the Cholesky factor of G G^T and room for the Taylor series of mu and of the unit normals.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from nsbench.compilation.decorators import inner_kernel
from nsbench.dynamics.contacts.kernels.contact_arrays import PAIR, ROW
from nsbench.linalg.skyline_cholesky import arrange, solve
from nsbench.solvers.event_driven.contacts.kernels.taylor_flow import (
    project_and_factor,
    sorted_index,
)

if TYPE_CHECKING:
    from nsbench.dynamics.contacts.kernels.contact_arrays import Contacts, Layout

# Pivot over its diagonal that counts as zero: contacts that lock or depend on each other.
LEAST_PIVOT = 1e-12


class HeldSet(NamedTuple):
    """Rows, factor and series of p active contacts, in the order of their entries.

    columns, values (p, width), count (p,): gradients as short rows, distances up to their sign.
    directions (p, 3, order + 2): Taylor coefficients of u = (x_p - x_q) / d. mu (p, order + 1):
    Taylor coefficients of the multipliers, lam = sign mu. plan: ordering and envelope of the
    factor.
    factor: Cholesky factor of G G^T in that envelope.
    """

    columns: np.ndarray
    values: np.ndarray
    count: np.ndarray
    directions: np.ndarray
    mu: np.ndarray
    plan: tuple
    factor: np.ndarray


@inner_kernel
def build_held_set(
    active: np.ndarray,
    contacts: Contacts,
    layout: Layout,
    norm: np.ndarray,
    x: np.ndarray,
    width: int,
    order: int,
    work: np.ndarray,
    length: float,
) -> tuple[bool, HeldSet]:
    """Factorise the Gram matrix of the active contacts and project x onto them.

    active (p,): entries of the candidates, ascending. x (n,): projected in place onto g = 0 (index
    reduction drifts). width: entries of the longest gradient. order: of the Taylor series that will
    follow. work (n,): zeros. length: characteristic length of the case.
    Returns (ok, HeldSet). ok is False if a pivot falls below LEAST_PIVOT: contacts that are
    dependent or locked.
    """
    p = active.size
    C = np.empty((p, width), np.int64)
    V = np.empty((p, width))
    count = np.zeros(p, np.int64)
    # orders are written before they are read
    U = np.empty((p, 3, order + 2))
    mu = np.empty((p, order + 1))
    kind, first, second, _, _, dim = contacts
    _, ptr, cols, _, _ = layout
    for a in range(p):  # the sparsity pattern alone: the ordering needs no values
        k = active[a]
        if kind[k] == ROW:
            for e in range(ptr[first[k]], ptr[first[k] + 1]):
                C[a, count[a]] = cols[e]
                count[a] += 1
        else:
            for c in range(dim[k]):
                C[a, c] = first[k] + c
                if kind[k] == PAIR:
                    C[a, dim[k] + c] = second[k] + c
            count[a] = 2 * dim[k] if kind[k] == PAIR else dim[k]
    # envelope of the Gram matrix; project_and_factor fills and factorises it
    plan = arrange(C, count, p, x.size)
    _, _, envelope, _, _ = plan
    held = HeldSet(C, V, count, U, mu, plan, np.empty(envelope[p]))
    ok = project_and_factor(active, held, contacts, layout, norm, x, work, LEAST_PIVOT, length)
    return ok, held


@inner_kernel
def gap_rate(
    k: int, contacts: Contacts, layout: Layout, x: np.ndarray, v: np.ndarray
) -> tuple[float, float]:
    """Return (G_k v, |G_k|^2) for entry k: the rate of its gap at velocity v, gradient squared.

    x, v (n,): state and velocity.
    """
    kind, p, q, d, sign, dim = contacts
    anchors, ptr, cols, vals, _ = layout
    s = 0.0
    size = 0.0
    if kind[k] == ROW:
        for e in range(ptr[p[k]], ptr[p[k] + 1]):
            s += vals[e] * v[cols[e]]
            size += vals[e] * vals[e]
        return s, size
    for c in range(dim[k]):
        u = (x[p[k] + c] - (x[q[k] + c] if kind[k] == PAIR else anchors[q[k] + c])) / d[k]
        s += u * (v[p[k] + c] - (v[q[k] + c] if kind[k] == PAIR else 0.0))
        size += u * u
    return sign[k] * s, size * (2.0 if kind[k] == PAIR else 1.0)


@inner_kernel
def _apply_transposed(held, active, z, n):
    """Return G^T z, (n,)."""
    C = held.columns
    V = held.values
    count = held.count
    out = np.zeros(n)
    for a in range(active.size):
        for e in range(count[a]):
            out[C[a, e]] += z[a] * V[a, e]
    return out


@inner_kernel
def inverse_column(
    entry: int, active: np.ndarray, held: HeldSet, n: int
) -> tuple[np.ndarray, float]:
    """Solve (G G^T) z = e_k for an active entry; return (G^T z / sqrt(z_k), z_k).

    active (p,): entries, ascending. The first result, (n,), has length one, is orthogonal to the
    other active gradients, and z_k is one over its squared product with gradient k.
    """
    z = np.zeros(active.size)
    k = sorted_index(active, entry)
    z[k] = 1.0
    solve(held.plan, active.size, held.factor, z, z)
    top = z[k]
    for a in range(active.size):
        z[a] /= np.sqrt(top)
    return _apply_transposed(held, active, z, n), top


@inner_kernel
def toggled(active: np.ndarray, entry: int, change: int) -> np.ndarray:
    """Return the ascending set with the entry put in (change 1) or taken out (change -1).

    active (p,): the ascending set before. Returns (p + change,).
    """
    out = np.empty(active.size + change, np.int64)
    a = sorted_index(active, entry)
    for i in range(a):
        out[i] = active[i]
    if change > 0:
        out[a] = entry
    for i in range(a if change > 0 else a + 1, active.size):
        out[i + change] = active[i]
    return out


@inner_kernel
def squared_sine_to_span(
    c: int, active: np.ndarray, held: HeldSet, contacts: Contacts, layout: Layout, x: np.ndarray
) -> float:
    """Return the squared sine of the angle between the gradient of entry c and the active span.

    active (p,): entries of the span; x (n,): state.
    """
    C = held.columns
    V = held.values
    count = held.count
    row = gradient(c, contacts, layout, x)
    r = np.empty(active.size)
    size = 0.0
    rest = 0.0
    for i in range(row.size):
        size += row[i] * row[i]
    # Project twice: the remainder of one projection is only as exact as the row is long.
    for _ in range(2):
        for a in range(active.size):
            r[a] = 0.0
            for e in range(count[a]):
                r[a] += V[a, e] * row[C[a, e]]
        solve(held.plan, active.size, held.factor, r, r)
        for a in range(active.size):
            for e in range(count[a]):
                row[C[a, e]] -= V[a, e] * r[a]
    for i in range(row.size):
        rest += row[i] * row[i]
    return rest / size


@inner_kernel
def gradient(k: int, contacts: Contacts, layout: Layout, x: np.ndarray) -> np.ndarray:
    """Return the gradient of entry k at x (n,) as a dense vector (n,); distances up to their
    sign."""
    kind, p, q, d, _, dim = contacts
    anchors, ptr, cols, vals, _ = layout
    row = np.zeros(x.size)
    if kind[k] == ROW:
        for e in range(ptr[p[k]], ptr[p[k] + 1]):
            row[cols[e]] += vals[e]
        return row
    for c in range(dim[k]):
        u = (x[p[k] + c] - (x[q[k] + c] if kind[k] == PAIR else anchors[q[k] + c])) / d[k]
        row[p[k] + c] = u
        if kind[k] == PAIR:
            row[q[k] + c] = -u
    return row
