"""Hard particles of one family stored cell by cell, and the candidates of a sweep among them.

Storage: particle s of the store is the one with label `label[s]`; it is sorted by cells at every
rebuild, so what is near in space is near in memory. The order of the sweep knows labels alone
(kernels.keys), so the store changes no bit.
Candidates: pairs (i, j) of the store and rows of A on one particle, (i, -1 - row).
"""

import numpy as np

from nsbench.compilation.decorators import njit
from nsbench.dynamics.contacts.kernels.constraint_order import CELL, sweep_key
from nsbench.solvers.pbd.kernels.conflict_schedule import divide, schedule

DEEP = (
    16.0  # rows are looked for in a list that reaches that many times as far, made anew less often
)


@njit(cache=True)
def workspace(n, m):
    """Arrays to work in, for n particles and m candidates; made by numpy (room.py_func) they lie on
    large pages.

    Of particles: label, store by label, row of cells, one to work in. Of candidates: three of two
    whole numbers each, that are i and j, impulse, and the chosen i and j (kernels.close) when a
    list is made; places or what is logged, what is waited for; keys or impulses of the chosen,
    impulses logged, where the chosen are.
    """
    return (
        np.arange(n).astype(np.int32),
        np.arange(n).astype(np.int32),
        np.empty(n, np.int32),
        np.empty(n + 1, np.int32),
    ), (
        np.empty(2 * m, np.int32),
        np.empty(2 * m, np.int32),
        np.empty(2 * m, np.int32),
        np.empty(m, np.int32),
        np.empty(m, np.int8),
        np.empty(m),
        np.empty(m),
        np.empty(m, np.int32),
    )


@njit(cache=True)
def listed(candidates, m):
    """i, j, impulse of the first m candidates."""
    half = candidates[3].size
    return candidates[0][:m], candidates[0][half : half + m], candidates[1].view(np.float64)[:m]


@njit(cache=True)
def by_cells(y, dim, size, cell, order, row):
    """Fill `order` (n,) with the particles sorted by cells and `row` with the row of each (sorted)
    one.

    Returns the first of each cell and the number of cells along each axis. The first axis runs
    fastest; a row counts along the last. Cells are at least `size` wide; at most about 4 n are
    made, however far particles are spread.
    """
    n = order.size
    num = np.ones(3, np.int64)
    width = np.ones(3)
    lo = np.zeros(3)
    cap = max(1.0, np.ceil((4.0 * n) ** (1.0 / dim)))
    for c in range(dim):
        a = y[c]
        z = y[c]
        for i in range(n):
            a = min(a, y[i * dim + c])
            z = max(z, y[i * dim + c])
        lo[c], width[c] = a, max(size, (z - a) / cap)
        num[c] = int((z - a) / width[c]) + 1
    first = np.zeros(num[0] * num[1] * num[2] + 1, np.int32)
    layer = 1
    for c in range(dim - 1):
        layer *= num[c]
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


@njit(cache=True)
def permute(values, order, dim, spare):
    """Move the entries (n, dim) of `values` to the new order."""
    for s in range(order.size):
        for c in range(dim):
            spare[s * dim + c] = values[order[s] * dim + c]
    values[:] = spare


@njit(cache=True, error_model="numpy")
def discs_between(y, d2, s, lo, hi, i, j, m):
    """Append the pairs of s with lo, ..., hi - 1 in the plane whose squared distance is at most d2;
    there is room. Indices are unsigned: numba then does not ask whether they count from the end.
    Returns the new length."""
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


@njit(cache=True, error_model="numpy")
def pairs_between(y, r, skin, dim, s, lo, hi, i, j, m):
    """The same in any dimension, with any radii: pairs whose gap is at most skin."""
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


@njit(cache=True, error_model="numpy")
def near_pairs(y, r, skin, dim, first, num, i, j):
    """Pairs i < j of the store (sorted by cells) with gap at most skin, written into i, j as long
    as there is room.

    r: radii (n,) in the order of the store, or (1,) if all are alike. Returns their number, -1
    where room was lacking.
    """
    m = 0
    n0 = num[0]
    n1 = num[1]
    n2 = num[2]
    lo = np.empty(5, np.int64)
    hi = np.empty(5, np.int64)
    d2 = (2.0 * r[0] + skin) ** 2
    discs = dim == 2 and r.size == 1
    for k in range(first.size - 1):
        if first[k] == first[k + 1]:
            continue
        k0 = k % n0
        k1 = (k // n0) % n1
        k2 = k // (n0 * n1)
        left = max(0, k0 - 1)
        right = min(n0, k0 + 2)
        # the rest of its own row of cells, then
        hi[0] = first[k - k0 + right]
        count = 1
        ahead = hi[0] - first[k]
        for a2 in range(k2, min(n2, k2 + 2)):  # rows of cells ahead, each a stretch of the store
            for a1 in range(k1 + 1 if a2 == k2 else max(0, k1 - 1), min(n1, k1 + 2)):
                lo[count] = first[(a2 * n1 + a1) * n0 + left]
                hi[count] = first[(a2 * n1 + a1) * n0 + right]
                ahead += hi[count] - lo[count]
                count += 1
        for s in range(first[k], first[k + 1]):
            if m + ahead > i.size:
                return -1
            lo[0] = s + 1
            for a in range(count):
                if discs:
                    m = np.int64(
                        discs_between(
                            y,
                            d2,
                            np.uint64(s),
                            np.uint64(lo[a]),
                            np.uint64(hi[a]),
                            i,
                            j,
                            np.uint64(m),
                        )
                    )
                else:
                    m = pairs_between(y, r, skin, dim, s, lo[a], hi[a], i, j, m)
    return m


@njit(cache=True, error_model="numpy")
def near_rows(y, store, rows, b, reach, dim, among, everything):
    """Rows of A, of those given or of all, that a move of their particle by `reach` can violate."""
    ptr, cols, vals, inv2 = rows
    which = np.empty(64, np.int32)
    m = 0
    for u in range(inv2.size if everything else among.size):
        q = u if everything else among[u]
        g = b[q]
        for e in range(ptr[q], ptr[q + 1]):
            g += vals[e] * y[store[cols[e] // dim] * dim + cols[e] % dim]
        if g * abs(g) * inv2[q] <= reach * reach:
            if m == which.size:
                which = np.concatenate((which, np.empty(m, np.int32)))
            which[m] = q
            m += 1
    return which[:m]


@njit(cache=True)
def fill_keys(i, j, label, number, families, order, seed, keys):
    """Keys of candidates. families (k, 2): the hard family, then each family of rows with its first
    row."""
    for c in range(i.size):
        if j[c] < 0:
            q = -1 - j[c]
            u = families.shape[0] - 1
            while families[u, 1] > q:
                u -= 1
            keys[c] = sweep_key(order, seed, families[u, 0], q - families[u, 1], 0)
        else:
            a = np.int64(label[i[c]])
            b = np.int64(label[j[c]])
            if order == CELL:
                a = number[a]
                b = number[b]
            keys[c] = sweep_key(order, seed, families[0, 0], min(a, b), max(a, b))


@njit(cache=True)
def carried(i, j, mu, label, kept):
    """Impulses that are not zero as (first label, second label or row, impulse), those `kept`
    before among them."""
    m = kept[2].size
    for c in range(mu.size):
        m += mu[c] != 0.0
    oi = np.empty(m, np.int32)
    oj = np.empty(m, np.int32)
    omu = np.empty(m)
    m = kept[2].size
    oi[:m], oj[:m], omu[:m] = kept
    for c in range(mu.size):
        if mu[c] != 0.0:
            oi[m] = label[i[c]]
            oj[m] = label[j[c]] if j[c] >= 0 else j[c]
            omu[m] = mu[c]
            m += 1
    return oi, oj, omu


@njit(cache=True)
def transfer_impulses(i, j, old, store, head, mu):
    """Fill the impulses of the candidates; returns what is left of the old ones: pairs that are no
    longer listed."""
    oi, oj, omu = old
    head[:] = -1
    after = np.empty(omu.size, np.int32)
    left = omu.size
    for e in range(omu.size):
        a = store[oi[e]]
        b = store[oj[e]] if oj[e] >= 0 else oj[e]
        if b > a:
            a, b = b, a  # kept at the later particle of the store; a row at its only one
        oi[e] = a
        oj[e] = b
        after[e] = head[a]
        head[a] = e
    for c in range(i.size):
        a = max(i[c], j[c])
        b = min(i[c], j[c])
        e = head[a]
        while e >= 0 and oj[e] != b:
            e = after[e]
        mu[c] = 0.0
        if e >= 0:
            mu[c] = omu[e]
            omu[e] = 0.0
            left -= 1
    ki = np.empty(left, np.int32)
    kj = np.empty(left, np.int32)
    kmu = np.empty(left)
    m = 0
    for e in range(omu.size):
        if omu[e] != 0.0:
            ki[m] = oi[e]
            kj[m] = oj[e]
            kmu[m] = omu[e]
            m += 1
    return ki, kj, kmu


@njit(cache=True)
def put(i, j, place, label, a, b):
    """The candidates in the order of execution, the lower label of a pair first."""
    for c in range(i.size):
        swap = j[c] >= 0 and label[i[c]] > label[j[c]]
        a[place[c]] = j[c] if swap else i[c]
        b[place[c]] = i[c] if swap else j[c]


@njit(cache=True)
def rebuild(
    crew,
    m,
    kept,
    particles,
    candidates,
    y,
    reac,
    base,
    spare,
    r,
    skin,
    dim,
    rows,
    b,
    which,
    families,
    number,
    order,
    seed,
    most,
):
    """The store sorted anew at y, and the candidates there in their order of execution, with their
    impulses.

    m: candidates held before; kept: impulses of pairs that left; particles, candidates: as made by
    `room`; spare (n dim,):
    to work in; which: the rows listed. Changes y, reac (sorted), base (= y). Returns m, kept, radii
    in the order of the store, pairs, and the candidates' arrays (longer ones if need be); m = -1
    where there are more than `most` pairs.
    """
    label, store, row, ends = particles
    old = carried(*listed(candidates, m), label, kept)
    n = label.size
    grid = spare.view(np.int32)[:n]
    cell = spare.view(np.int32)[n : 2 * n]
    first, num = by_cells(y, dim, 2.0 * r.max() + skin, cell, grid, row)
    permute(y, grid, dim, base)
    permute(reac, grid, dim, base)
    base[:] = y
    for s in range(n):
        cell[s] = label[grid[s]]
    label[:] = cell
    for s in range(n):
        store[label[s]] = s
    radii = r if r.size == 1 else r[label]
    while True:
        half = candidates[3].size
        a = candidates[2][:half]
        c = candidates[2][half:]
        pairs = near_pairs(y, radii, skin, dim, first, num, a, c)
        if 0 <= pairs <= most and pairs + which.size <= half:
            break
        if pairs > most or (pairs < 0 and half > most + n):
            return -1, kept, radii, pairs, candidates
        if (
            crew is not None
        ):  # its arrays are known to all threads: the run is begun anew with longer ones
            return -2 * half - which.size, kept, radii, pairs, candidates
        candidates = workspace(0, 2 * half + which.size)[1]
    ids, after, _, place, need = candidates[:5]
    keys = candidates[5].view(np.uint64)
    m = pairs + which.size
    for e in range(which.size):
        a[pairs + e] = store[rows[1][rows[0][which[e]]] // dim]
        c[pairs + e] = -1 - which[e]
    fill_keys(a[:m], c[:m], label, number, families, order, seed, keys[:m])
    schedule(a[:m], c[:m], keys[:m], row, ends, ids[: 2 * m], after[: 2 * m], need[:m], place[:m])
    if crew is not None:
        divide(a[:m], c[:m], after[: 2 * m], place[:m], ids[:m], need[:m], n, crew[4])
    i, j, mu = listed(candidates, m)
    put(a[:m], c[:m], place[:m], label, i, j)
    kept = transfer_impulses(i, j, old, store, grid, mu)
    for e in range(kept[2].size):
        kept[0][e], kept[1][e] = (
            label[kept[0][e]],
            label[kept[1][e]] if kept[1][e] >= 0 else kept[1][e],
        )
    return m, kept, radii, pairs, candidates
