"""Cell lists: all pairs of particles i < j with |x_i - x_j| <= r_i + r_j + reach, sorted."""

import numpy as np

from nsbench.compilation.decorators import inner_kernel, njit
from nsbench.linalg.max_norm import largest

X, Y, Z = range(3)  # axes of the grid


@inner_kernel
def _cells(x, start, n, dim, size):
    """Sort the particles into the cells of a grid.

    Returns the cell of each particle, the members by cell (CSR: starts and members), and the grid's
    shape. Cells are at least `size` wide, and there are at most about 4 n of them, however far the
    particles are spread.
    """
    # The extent of the particles along each axis decides the number of cells.
    lo = np.empty(3)
    num = np.ones(3, np.int64)
    width = np.ones(3)
    cap = max(1.0, np.ceil((4.0 * n) ** (1.0 / dim)))
    for c in range(dim):
        a = x[start + c]
        z = a
        for i in range(n):
            v = x[start + i * dim + c]
            a = min(a, v)
            z = max(z, v)
        lo[c] = a
        w = max(size, (z - a) / cap)
        w = w if w > 0.0 else 1.0  # points on a line, without a size
        width[c] = w
        num[c] = int((z - a) / w) + 1
    total = 1
    for c in range(dim):
        total *= num[c]
    # Counting sort by the number of the cell.
    cell = np.empty(n, np.int64)
    first = np.zeros(total + 1, np.int64)
    for i in range(n):
        k = 0
        for c in range(dim):
            k = k * num[c] + min(num[c] - 1, int((x[start + i * dim + c] - lo[c]) / width[c]))
        cell[i] = k
        first[k + 1] += 1
    for k in range(total):
        first[k + 1] += first[k]
    fill = first[:total].copy()
    member = np.empty(n, np.int64)
    for i in range(n):
        member[fill[cell[i]]] = i
        fill[cell[i]] += 1
    return cell, first, member, num


@njit(cache=True)
def near_pairs(
    x: np.ndarray, start: int, n: int, dim: int, r: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """List the pairs (i, j), i < j, whose gap |x_i - x_j| - r_i - r_j is at most `reach`.

    x (N,), finite: particle i has its coordinates at x[start + i dim], dim of them. r (n,): radii.
    reach: a length. Returns i and j, two int64 arrays, sorted by i then j.
    """
    cell, first, member, num = _cells(x, start, n, dim, 2.0 * largest(r) + reach)
    cap = 4 * n + 16
    pi = np.empty(cap, np.int64)
    pj = np.empty(cap, np.int64)
    m = 0
    n1 = num[Y] if dim > 1 else 1
    n2 = num[Z] if dim > 2 else 1
    # Cell list search: the 3^dim cells around each particle; insertion sort of its partners by j.
    for i in range(n):
        k = cell[i]
        k2 = k % n2 if dim > 2 else 0
        k1 = (k // n2) % n1 if dim > 1 else 0
        k0 = k // (n1 * n2)
        row = m
        for a0 in range(max(0, k0 - 1), min(num[X], k0 + 2)):
            for a1 in range(max(0, k1 - 1), min(n1, k1 + 2)):
                for a2 in range(max(0, k2 - 1), min(n2, k2 + 2)):
                    c = (a0 * n1 + a1) * n2 + a2
                    for e in range(first[c], first[c + 1]):
                        j = member[e]
                        if j <= i:
                            continue
                        s = 0.0
                        for u in range(dim):
                            w = x[start + i * dim + u] - x[start + j * dim + u]
                            s += w * w
                        far = r[i] + r[j] + reach
                        if s > far * far:
                            continue
                        if m == cap:
                            cap *= 2
                            pi = np.concatenate((pi, np.empty(cap - m, np.int64)))
                            pj = np.concatenate((pj, np.empty(cap - m, np.int64)))
                        f = m
                        while f > row and pj[f - 1] > j:
                            pj[f] = pj[f - 1]
                            f -= 1
                        pj[f] = j
                        pi[m] = i
                        m += 1
    return pi[:m].copy(), pj[:m].copy()
