"""Select the few candidates of a list that can become active soon (a second, smaller Verlet skin).

A list of near pairs serves many steps and is expensive to build, so it is long: in a dense packing
three of four of its candidates do nothing. The sweep therefore runs over those alone, in the same
order, whose gap is at most a smaller skin; nothing else can become active while no particle is
farther than half of that skin from where they were selected. Selecting reads the list once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from nsbench.compilation.decorators import inner_kernel

if TYPE_CHECKING:
    from nsbench.dynamics.contacts.kernels.contact_arrays import AffineRows
    from nsbench.solvers.pbd.kernels.cell_storage import CandidateArrays, CellScene

# cost of reading a list once over that of a step of the sweep over what a skin of one radius adds;
# estimated
READ_OVER_SWEEP = 2.4


@inner_kernel
def row_gap(y: np.ndarray, s: int, q: int, rows: AffineRows, b: np.ndarray, dim: int) -> float:
    """Return the value of row q at particle s of the store, positions y (n dim,)."""
    g = b[q]
    for e in range(rows.ptr[q], rows.ptr[q + 1]):
        g += rows.vals[e] * y[s * dim + rows.cols[e] % dim]
    return g


@inner_kernel
def select_active(
    arrays: CandidateArrays, count: int, y: np.ndarray, r: np.ndarray, skin: float, scene: CellScene
) -> int:
    """Write the candidates with a gap of at most skin to the active ones; returns their number.

    arrays: CandidateArrays, count: candidates in them; y (n dim,): positions in the order of the
    store; r (n,), or (1,) if all are alike: radii; scene: CellScene. Rows of moving walls are all
    selected.
    """
    half = arrays.log_at.size
    i = arrays.pairs[:half]
    j = arrays.pairs[half:]
    mu = arrays.successors.view(np.float64)
    near_i = arrays.active_pairs[:half]
    near_j = arrays.active_pairs[half:]
    near_mu = arrays.active_mu
    where = arrays.active_at
    rows = scene.rows
    dim = scene.dim
    d = 2.0 * r[0] + skin
    k = np.uint64(0)
    alike = r.size == 1
    one = np.uint64(1)
    two = np.uint64(2)
    plane = dim == 2 and r.size == 1
    d2 = d * d
    # Written without branches: each candidate is stored, and counted only if it is near.
    for c in range(count):
        near_i[k] = i[c]
        near_j[k] = j[c]
        where[k] = c
        if j[c] < 0:
            q = -1 - j[c]
            g = row_gap(y, i[c], q, rows, scene.b, dim)
            k += np.uint64(scene.moving or g * abs(g) * rows.inv2[q] <= 0.25 * skin * skin)
        elif plane:
            p = two * np.uint64(i[c])
            q = two * np.uint64(j[c])
            u = y[p] - y[q]
            v = y[p + one] - y[q + one]
            k += np.uint64(u * u + v * v <= d2)
        else:
            if not alike:
                d = r[i[c]] + r[j[c]] + skin
            s = 0.0
            for e in range(dim):
                u = y[i[c] * dim + e] - y[j[c] * dim + e]
                s += u * u
            k += np.uint64(s <= d * d)
    for c in range(k):
        near_mu[c] = mu[where[c]]
    return np.int64(k)


@inner_kernel
def restore_impulses(arrays: CandidateArrays, active: int) -> None:
    """Write the impulses of the first `active` active candidates back to the list."""
    mu = arrays.successors.view(np.float64)
    where = arrays.active_at
    near_mu = arrays.active_mu
    for c in range(active):
        mu[where[c]] = near_mu[c]


@inner_kernel
def inner_skin(pace: float, radius: float, skin: float) -> float:
    """Return the cheapest skin of the active candidates, from 0.1 to 0.6 of that of the list.

    pace: distance that the fastest particle moves in a step; radius: mean radius; all lengths.
    """
    # Reading costs 1 / skin per step, the sweep grows with the skin: the least sum is at the root.
    return min(0.6 * skin, max(0.1 * skin, np.sqrt(READ_OVER_SWEEP * pace * radius)))
