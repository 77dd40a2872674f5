"""Sparse L D L^T factorisation of Gram matrices M = G G^T, ordered by nested dissection.

The rows of G (m, n) are given in CSR form (see SparsityPattern). `nested_dissection_order` orders
the rows, `factor` factors M_AA for any subset A of them, `back` solves with the factor; `push`,
`slack` and `lengths` are products with G.
Sources: George & Liu, Computer Solution of Large Sparse Positive Definite Systems, 1981 (ordering);
T. Davis, Algorithm 849, ACM TOMS 31(4), 2005 (up-looking factorisation).
"""

from typing import NamedTuple

import numpy as np

from nsbench.compilation.decorators import inner_kernel, njit

SMALL = 24  # rows of a part: one this small is dense enough, dissecting it further gains nothing

# L by columns: start (na,), count (na,), row and value of each entry
SparseFactor = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


class SparsityPattern(NamedTuple):
    """Where G (m, n) has entries, and an order of elimination for G G^T.

    CSR: row k has the entries ptr[k] : ptr[k + 1], in the columns cols. Its transpose: coordinate c
    is used by the entries tpos[tptr[c] : tptr[c + 1]] of the rows trow[...]. order (m,): rows in an
    order of elimination; order[0] < 0 where it has not been computed.
    """

    ptr: np.ndarray
    cols: np.ndarray
    tptr: np.ndarray
    trow: np.ndarray
    tpos: np.ndarray
    order: np.ndarray


@inner_kernel
def visits(ptr: np.ndarray, cols: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Transpose a CSR pattern: tptr (n + 1,), trow, tpos (see SparsityPattern), rows ascending in
    every column."""
    # Counting sort of the entries by column.
    tptr = np.zeros(n + 1, np.int64)
    for c in cols:
        tptr[c + 1] += 1
    for c in range(n):
        tptr[c + 1] += tptr[c]
    fill = np.empty(n, np.int64)
    for c in range(n):
        fill[c] = tptr[c]
    trow = np.empty(cols.size, np.int64)
    tpos = np.empty(cols.size, np.int64)
    for k in range(ptr.size - 1):
        for e in range(ptr[k], ptr[k + 1]):
            f = fill[cols[e]]
            fill[cols[e]] += 1
            trow[f] = k
            tpos[f] = e
    return tptr, trow, tpos


@inner_kernel
def levels(
    root: int,
    part: int,
    label: np.ndarray,
    ptr: np.ndarray,
    cols: np.ndarray,
    tptr: np.ndarray,
    trow: np.ndarray,
    queue: np.ndarray,
    level: np.ndarray,
) -> int:
    """Search breadth-first from root through the rows with label `part`.

    label (m,); queue (m,): filled with the rows reached, in order; level (m,): with their distances
    from root. Returns how many were reached.
    """
    queue[0] = root
    level[root] = 0
    label[root] = -part
    done = 0
    found = 1
    # breadth-first search; rows that share a column are neighbours
    while done < found:
        v = queue[done]
        done += 1
        for e in range(ptr[v], ptr[v + 1]):
            for f in range(tptr[cols[e]], tptr[cols[e] + 1]):
                u = trow[f]
                if label[u] == part:
                    label[u] = -part
                    level[u] = level[v] + 1
                    queue[found] = u
                    found += 1
    for k in range(found):
        label[queue[k]] = part
    return found


@inner_kernel
def nested_dissection_order(
    ptr: np.ndarray, cols: np.ndarray, tptr: np.ndarray, trow: np.ndarray
) -> np.ndarray:
    """Return the rows (m,) in an order of elimination: nested dissection by the middle level of a
    breadth-first search.

    Source: George & Liu 1981, section 8.
    """
    m = ptr.size - 1
    order = np.arange(m)
    label = np.ones(m, np.int64)
    if m <= SMALL:
        return order
    queue = np.empty(m, np.int64)
    level = np.empty(m, np.int64)
    todo = np.empty((m + 1, 2), np.int64)
    todo[0, 0] = 0
    todo[0, 1] = m
    depth = 1
    part = 1
    # nested dissection, by a stack of parts to be cut
    while depth > 0:
        depth -= 1
        lo = todo[depth, 0]
        hi = todo[depth, 1]
        part += 1
        for k in range(lo, hi):
            label[order[k]] = part
        # twice: the last row reached is nearly peripheral, so levels from it are thin
        found = levels(order[lo], part, label, ptr, cols, tptr, trow, queue, level)
        found = levels(queue[found - 1], part, label, ptr, cols, tptr, trow, queue, level)
        cut = level[queue[found // 2]]
        if found == hi - lo and (found <= SMALL or cut == 0 or cut == level[queue[found - 1]]):
            for k in range(found):
                order[hi - 1 - k] = queue[k]
            continue
        if found < hi - lo:
            mid = lo + found
            end = hi
            separate_component(order, lo, hi, queue, found, label)
        else:
            mid, end = _cut_at_level(order, lo, hi, queue, found, level, cut)
        if mid > lo:
            todo[depth, 0] = lo
            todo[depth, 1] = mid
            depth += 1
        if end > mid:
            todo[depth, 0] = mid
            todo[depth, 1] = end
            depth += 1
    return order


@inner_kernel
def separate_component(
    order: np.ndarray, lo: int, hi: int, queue: np.ndarray, found: int, label: np.ndarray
) -> int:
    """Put the `found` rows of a connected component, in queue, before the rest of the part
    order[lo:hi].

    order, queue, label (m,). Returns how many rows are in queue then: all of the part.
    """
    for k in range(found):
        label[queue[k]] = 0
    for k in range(lo, hi):
        if label[order[k]] != 0:
            queue[found] = order[k]
            found += 1
    for k in range(found):
        order[lo + k] = queue[k]
    return found


@inner_kernel
def _cut_at_level(order, lo, hi, queue, found, level, cut):
    """Put into order[lo:hi] the rows in front of the level `cut`, those behind it, and the level
    last; returns where the second and the third group begin."""
    mid = lo
    end = hi
    for k in range(found - 1, -1, -1):
        if level[queue[k]] == cut:
            end -= 1
            order[end] = queue[k]
    at = end
    for k in range(found - 1, -1, -1):
        if level[queue[k]] > cut:
            at -= 1
            order[at] = queue[k]
    for k in range(found):
        if level[queue[k]] < cut:
            order[mid] = queue[k]
            mid += 1
    return mid, end


@inner_kernel
def _symbolic(act, slot, ptr, cols, tptr, trow):
    """Return the elimination tree (na,) of the chosen rows and the start (na + 1,) of each column
    of L."""
    # Elimination tree and column counts by walks up the tree (Liu 1990; Davis 2005).
    na = act.size
    parent = np.full(na, -1)
    mark = np.full(na, -1)
    start = np.zeros(na + 1, np.int64)
    for k in range(na):
        mark[k] = k
        r = act[k]
        for e in range(ptr[r], ptr[r + 1]):
            for f in range(tptr[cols[e]], tptr[cols[e] + 1]):
                i = slot[trow[f]]
                if i < 0 or i >= k:
                    continue
                while mark[i] != k:
                    if parent[i] == -1:
                        parent[i] = k
                    start[i + 1] += 1
                    mark[i] = k
                    i = parent[i]
    for k in range(na):
        start[k + 1] += start[k]
    return parent, start


@inner_kernel
def factor(
    act, slot, ptr, cols, vals, tptr, trow, tpos, tol: float, shift: float
) -> tuple[SparseFactor, np.ndarray]:
    """Factor M_AA = L D L^T for the rows act (na,), the diagonal of M_AA times 1 + shift.

    slot (m,): their places in act, -1 elsewhere.

    A row whose squared sine to the rows before it is at most `tol` depends on them: D = 0 there,
    and `back` gives it the multiplier 0. Returns (L by columns: start, count, row, value), D.
    """
    na = act.size
    parent, start = _symbolic(act, slot, ptr, cols, tptr, trow)
    row = np.empty(start[na], np.int64)
    value = np.empty(start[na])
    count = np.zeros(na, np.int64)
    D = np.zeros(na)
    y = np.zeros(na)
    mark = np.full(na, -1)
    path = np.empty(na, np.int64)
    stack = np.empty(na, np.int64)
    # up-looking factorisation (Davis 2005): row k of L by a solve with the rows before it
    for k in range(na):
        top = na
        mark[k] = k
        r = act[k]
        for e in range(ptr[r], ptr[r + 1]):
            for f in range(tptr[cols[e]], tptr[cols[e] + 1]):
                i = slot[trow[f]]
                if i < 0 or i > k:
                    continue
                y[i] += vals[e] * vals[tpos[f]]
                depth = 0
                while mark[i] != k:
                    path[depth] = i
                    depth += 1
                    mark[i] = k
                    i = parent[i]
                while depth > 0:
                    depth -= 1
                    top -= 1
                    stack[top] = path[depth]
        whole = y[k]
        d = y[k] * (1.0 + shift)
        y[k] = 0.0
        for s in range(top, na):
            i = stack[s]
            yi = y[i]
            y[i] = 0.0
            if D[i] == 0.0:
                continue
            end = start[i] + count[i]
            for e in range(start[i], end):
                y[row[e]] -= value[e] * yi
            lki = yi / D[i]
            d -= lki * yi
            row[end] = k
            value[end] = lki
            count[i] += 1
        D[k] = d if d > tol * whole else 0.0
    return (start, count, row, value), D


@inner_kernel
def back(L: SparseFactor, D: np.ndarray, b: np.ndarray) -> None:
    """Solve L D L^T x = b in place, D, b (na,); the entries of dependent rows become 0."""
    start, count, row, value = L
    # Forward substitution by columns of L, then backward substitution.
    for i in range(D.size):
        if D[i] == 0.0:
            b[i] = 0.0
            continue
        for e in range(start[i], start[i] + count[i]):
            b[row[e]] -= value[e] * b[i]
    for i in range(D.size - 1, -1, -1):
        if D[i] == 0.0:
            continue
        s = b[i] / D[i]
        for e in range(start[i], start[i] + count[i]):
            s -= value[e] * b[row[e]]
        b[i] = s


@inner_kernel
def push(P: SparsityPattern, vals: np.ndarray, mu: np.ndarray, d: np.ndarray) -> None:
    """Fill d (n,) with G^T mu, mu (m,); vals (e,): entries of G."""
    ptr = P.ptr
    cols = P.cols
    for c in range(d.size):
        d[c] = 0.0
    for k in range(mu.size):
        if mu[k] != 0.0:
            for e in range(ptr[k], ptr[k + 1]):
                d[cols[e]] += vals[e] * mu[k]


@njit(cache=True, error_model="numpy")
def slack(
    P: SparsityPattern, vals: np.ndarray, q: np.ndarray, d: np.ndarray, w: np.ndarray
) -> None:
    """Fill w (m,) with q + G d, d (n,); vals (e,): entries of G."""
    ptr = P.ptr
    cols = P.cols
    for k in range(q.size):
        s = q[k]
        for e in range(ptr[k], ptr[k + 1]):
            s += vals[e] * d[cols[e]]
        w[k] = s


@inner_kernel
def lengths(P: SparsityPattern, vals: np.ndarray) -> np.ndarray:
    """Return the length |G_k| of every row, (m,)."""
    ptr = P.ptr
    out = np.empty(P.ptr.size - 1)
    for k in range(out.size):
        s = 0.0
        for e in range(ptr[k], ptr[k + 1]):
            s += vals[e] * vals[e]
        out[k] = np.sqrt(s)
    return out


@inner_kernel
def choose(on: np.ndarray, order: np.ndarray, slot: np.ndarray) -> np.ndarray:
    """Return the rows that are `on`, in the order of elimination, and fill slot (m,) with their
    places, -1 elsewhere."""
    act = np.empty(on.size, np.int64)
    na = 0
    for k in order:
        slot[k] = -1
        if on[k]:
            slot[k] = na
            act[na] = k
            na += 1
    return act[:na]
