"""Search for the near pairs and rows of hard particles that are stored cell by cell.

Cells are boxes at least as wide as the cutoff, so near pairs lie in the same or in neighbouring
cells (linked-cell method: Hockney & Eastwood, Computer Simulation Using Particles, 1988, chapter
8). As the store is sorted by cells, a row of neighbouring cells is one stretch of it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from nsbench.compilation.decorators import inner_kernel

if TYPE_CHECKING:
    from nsbench.dynamics.contacts.kernels.contact_arrays import AffineRows


@inner_kernel
def by_cells(
    y: np.ndarray, dim: int, size: float, cell: np.ndarray, order: np.ndarray, row: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Sort n particles by cells: fill `order` (n,) with them and `row` (n,) with the row of each.

    y (n dim,): positions. size: least width of a cell. cell (n,): work array. Returns `first`, the
    first particle of each cell, and the number of cells along each of three axes. The first axis
    runs fastest; a row counts along the last. At most about 4 n cells are made, however far
    particles are spread.
    """
    n = order.size
    lo, width, num = _cell_geometry(y, dim, size, n)
    n0, n1, n2 = num
    first = np.zeros(n0 * n1 * n2 + 1, np.int32)
    layer = 1
    for c in range(dim - 1):
        layer *= num[c]
    # counting sort by the number of the cell
    for i in range(n):
        k = 0
        for c in range(dim - 1, -1, -1):
            k = k * num[c] + min(num[c] - 1, int((y[i * dim + c] - lo[c]) / width[c]))
        cell[i] = k
        first[k + 1] += 1
    for k in range(first.size - 1):
        first[k + 1] += first[k]
    for i in range(n):
        k = cell[i]
        order[first[k]] = i
        row[first[k]] = k // layer
        first[k] += 1
    for k in range(first.size - 1, 0, -1):  # filling has moved each start to its end
        first[k] = first[k - 1]
    first[0] = 0
    return first, num


@inner_kernel
def _cell_geometry(y, dim, size, n):
    """Return lower corner, widths and numbers of the cells along three axes."""
    num = np.ones(3, np.int64)
    width = np.ones(3)
    lo = np.zeros(3)
    cap = max(1.0, np.ceil((4.0 * n) ** (1.0 / dim)))
    for c in range(dim):
        least = y[c]
        largest = y[c]
        for i in range(n):
            least = min(least, y[i * dim + c])
            largest = max(largest, y[i * dim + c])
        lo[c] = least
        width[c] = max(size, (largest - least) / cap)
        num[c] = int((largest - least) / width[c]) + 1
    return lo, width, num


@inner_kernel
def permute(values: np.ndarray, order: np.ndarray, dim: int, spare: np.ndarray) -> None:
    """Move the entries (n, dim) of `values` to the new order; spare (n dim,): work array."""
    for s in range(order.size):
        for c in range(dim):
            spare[s * dim + c] = values[order[s] * dim + c]
    values[:] = spare


@inner_kernel
def discs_between(
    y: np.ndarray, d2: float, s: int, lo: int, hi: int, i: np.ndarray, j: np.ndarray, m: int
) -> int:
    """Append the pairs of s with lo, ..., hi - 1 in the plane whose squared distance is at most d2.

    y (2 n,): positions. i, j have enough entries left. Returns the new length. Indices are
    unsigned: numba then does not test whether they count from the end.
    """
    one = np.uint64(1)
    two = np.uint64(2)
    a = y[two * s]
    b = y[two * s + one]
    q = lo
    while q < hi:
        u = a - y[two * q]
        v = b - y[two * q + one]
        i[m] = s
        j[m] = q
        m += np.uint64(u * u + v * v <= d2)
        q += one
    return m


@inner_kernel
def pairs_between(
    y: np.ndarray,
    r: np.ndarray,
    skin: float,
    dim: int,
    s: int,
    lo: int,
    hi: int,
    i: np.ndarray,
    j: np.ndarray,
    m: int,
) -> int:
    """Append the pairs of s with lo, ..., hi - 1 whose gap is at most skin, in any dimension.

    y (n dim,): positions; r (n,), or (1,): radii. i, j have enough entries left. Returns the new
    length.
    """
    d = 2.0 * r[0] + skin
    for q in range(lo, hi):
        if r.size > 1:
            d = r[s] + r[q] + skin
        g = 0.0
        for c in range(dim):
            e = y[s * dim + c] - y[q * dim + c]
            g += e * e
        i[m] = s
        j[m] = q
        m += g <= d * d
    return m


@inner_kernel
def near_pairs(
    y: np.ndarray,
    r: np.ndarray,
    skin: float,
    dim: int,
    first: np.ndarray,
    num: np.ndarray,
    i: np.ndarray,
    j: np.ndarray,
) -> int:
    """Write the pairs i < j of the store with a gap of at most skin into i, j.

    y (n dim,): positions, sorted by cells; r: radii (n,) in the order of the store, or (1,) if all
    are alike; first, num: as by_cells returns them. Returns the number of pairs, or -1 if i, j are
    too short.
    """
    m = 0
    n0, n1, n2 = num
    lo = np.empty(5, np.int64)
    hi = np.empty(5, np.int64)
    d2 = (2.0 * r[0] + skin) ** 2
    discs = dim == 2 and r.size == 1
    # Linked-cell method: of each pair of neighbouring cells only the one ahead is searched.
    for k in range(first.size - 1):
        if first[k] == first[k + 1]:
            continue
        count, ahead = _stretches_ahead(k, n0, n1, n2, first, lo, hi)
        for s in range(first[k], first[k + 1]):
            if m + ahead > i.size:
                return -1
            lo[0] = s + 1
            for a in range(count):
                if discs:
                    us = np.uint64(s)
                    ul = np.uint64(lo[a])
                    uh = np.uint64(hi[a])
                    m = np.int64(discs_between(y, d2, us, ul, uh, i, j, np.uint64(m)))
                else:
                    m = pairs_between(y, r, skin, dim, s, lo[a], hi[a], i, j, m)
    return m


@inner_kernel
def _stretches_ahead(k, n0, n1, n2, first, lo, hi):
    """Fill lo, hi with the stretches of the store that hold the neighbours ahead of cell k.

    Returns their number and how many particles they hold at most. The first stretch is the rest of
    the row of cells of k, from the particle at hand on: its lo is set by the caller.
    """
    k0 = k % n0
    k1 = (k // n0) % n1
    k2 = k // (n0 * n1)
    left = max(0, k0 - 1)
    right = min(n0, k0 + 2)
    hi[0] = first[k - k0 + right]
    count = 1
    ahead = hi[0] - first[k]
    for a2 in range(k2, min(n2, k2 + 2)):  # rows of cells ahead, each a stretch of the store
        for a1 in range(k1 + 1 if a2 == k2 else max(0, k1 - 1), min(n1, k1 + 2)):
            lo[count] = first[(a2 * n1 + a1) * n0 + left]
            hi[count] = first[(a2 * n1 + a1) * n0 + right]
            ahead += hi[count] - lo[count]
            count += 1
    return count, ahead


@inner_kernel
def near_rows(
    y: np.ndarray,
    store: np.ndarray,
    rows: AffineRows,
    b: np.ndarray,
    reach: float,
    dim: int,
    among: np.ndarray,
    everything: bool,
) -> np.ndarray:
    """Return the rows of A that a displacement of their particle by `reach` can violate.

    store (n,): place of each label; rows: AffineRows; b: their constants; among: the rows tested,
    or, with everything, all.
    """
    which = np.empty(64, np.int32)
    m = 0
    for u in range(rows.inv2.size if everything else among.size):
        q = u if everything else among[u]
        g = b[q]
        for e in range(rows.ptr[q], rows.ptr[q + 1]):
            g += rows.vals[e] * y[store[rows.cols[e] // dim] * dim + rows.cols[e] % dim]
        # gap |g| / |A_q|, signed and squared, without a square root
        if g * abs(g) * rows.inv2[q] <= reach * reach:
            if m == which.size:
                which = np.concatenate((which, np.empty(m, np.int32)))
            which[m] = q
            m += 1
    return which[:m]
