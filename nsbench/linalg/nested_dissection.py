"""Nested dissection of coordinates: the order and the assembly tree for factors of I + G^T W G.

The factors are those of linalg.multifrontal.

Two coordinates are neighbours if a row of G uses both. A part is split by the middle level of a
breadth-first search; the level comes last and is a part of its own, so nothing in front of it meets
anything behind it, whatever the weights of the rows are: the tree depends on where G has entries
only. Source: George & Liu, Computer Solution of Large Sparse Positive Definite Systems, 1981,
section 8; fronts: Duff & Reid, ACM TOMS 9(3), 1983.
"""

from typing import NamedTuple

import numpy as np

from nsbench.compilation.decorators import inner_kernel
from nsbench.linalg.sparse_ldl import levels, separate_component

# at most this part of the coordinates on one side of a cut; the smallest level is taken
BALANCE = 0.6
LEAF = 32  # coordinates of a part that is not cut any more: dense loops are faster there

# indices of AssemblyTree.sizes
LARGEST_FRONT = 0
STACK = 1


class AssemblyTree(NamedTuple):
    """The fronts of a pattern, in order of elimination (children before parents).

    order (n,): coordinate at each place. first (parts + 1,): places of a part. up (parts,): the
    part above, -1 for none. bptr (parts + 1,), border: places behind a part that its front holds
    too; rel: where those lie in the front above. panel (parts + 1,): where its rows of the factor
    begin. optr (parts + 1,), orow: rows of G that belong to a part; loc: place of each entry of G
    in the front of its row. sizes: order of the largest front, and length of the stack of what
    children hand up.
    """

    order: np.ndarray
    first: np.ndarray
    up: np.ndarray
    bptr: np.ndarray
    border: np.ndarray
    rel: np.ndarray
    panel: np.ndarray
    optr: np.ndarray
    orow: np.ndarray
    loc: np.ndarray
    sizes: np.ndarray


@inner_kernel
def _reaches(v, up, level, ptr, cols, tptr, trow):
    """Has coordinate v a neighbour of the level `up`?"""
    for f in range(tptr[v], tptr[v + 1]):
        for e in range(ptr[trow[f]], ptr[trow[f] + 1]):
            if level[cols[e]] == up:
                return True
    return False


@inner_kernel
def _thinnest(queue, level, found):
    """Return the smallest level that leaves no more than BALANCE of the part on either side."""
    at = int(found * (1.0 - BALANCE))
    best = level[queue[found // 2]]
    least = found
    while at < found * BALANCE:
        here = level[queue[at]]
        end = at
        while at > 0 and level[queue[at - 1]] == here:
            at -= 1
        while end < found and level[queue[end]] == here:
            end += 1
        if end - at < least:
            best = here
            least = end - at
        at = end
    return best


@inner_kernel
def _pieces(ptr, cols, tptr, trow, order, label, queue, level, todo):
    """Put connected coordinates next to each other in `order`, small components in common parts.

    Fills todo with the parts (begin, end, -1); returns their number and the last label used.
    """
    n = order.size
    done = 0
    depth = 0
    for c in range(n):
        if label[c] != 1:
            continue
        found = levels(c, 1, label, tptr, trow, ptr, cols, queue, level)
        if depth > 0 and todo[depth - 1, 1] - todo[depth - 1, 0] + found <= LEAF:
            todo[depth - 1, 1] += found
        else:
            todo[depth, 0] = done
            todo[depth, 1] = done + found
            todo[depth, 2] = -1
            depth += 1
        for k in range(found):
            order[done] = queue[k]
            label[queue[k]] = 2
            level[queue[k]] = -1
            done += 1
    return depth, 2


@inner_kernel
def nested_dissection(
    ptr: np.ndarray, cols: np.ndarray, tptr: np.ndarray, trow: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return an order of elimination (n,) of the coordinates, and above (n,): -2 inside a part, at
    its first place the place where the part above it begins, -1 for none."""
    n = tptr.size - 1
    order = np.empty(n, np.int64)
    label = np.ones(n, np.int64)
    above = np.full(n, -2)
    queue = np.empty(n, np.int64)
    level = np.full(n, -1)
    todo = np.empty((n + 1, 3), np.int64)
    depth, part = _pieces(ptr, cols, tptr, trow, order, label, queue, level, todo)
    # nested dissection (George & Liu 1981), by a stack of parts to be cut
    while depth > 0:
        depth -= 1
        lo = todo[depth, 0]
        hi = todo[depth, 1]
        up = todo[depth, 2]
        part += 1
        for k in range(lo, hi):
            label[order[k]] = part
        found = levels(order[lo], part, label, tptr, trow, ptr, cols, queue, level)
        if hi - lo > LEAF:
            found = levels(queue[found - 1], part, label, tptr, trow, ptr, cols, queue, level)
        middle = _thinnest(queue, level, found)
        last = level[queue[found - 1]]
        mid = lo + found
        end = hi
        if found < hi - lo and hi - lo > LEAF:
            found = separate_component(order, lo, hi, queue, found, label)
        elif found == hi - lo and found > LEAF and 0 < middle < last:
            mid, end = _cut_at_level(
                order, lo, hi, queue, found, level, middle, ptr, cols, tptr, trow
            )
            above[end] = up
            up = end
        else:
            mid = end = lo
            above[lo] = up
        for k in range(found):
            level[queue[k]] = -1
        if mid > lo:
            todo[depth, 0] = lo
            todo[depth, 1] = mid
            todo[depth, 2] = up
            depth += 1
        if end > mid:
            todo[depth, 0] = mid
            todo[depth, 1] = end
            todo[depth, 2] = up
            depth += 1
    return order, above


@inner_kernel
def _cut_at_level(order, lo, hi, queue, found, level, middle, ptr, cols, tptr, trow):
    """Put into order[lo:hi] the coordinates in front of the level `middle`, those behind it, and
    last those of the level that have a neighbour behind it; returns where the second and the third
    group begin."""
    mid = lo
    end = hi
    for k in range(found - 1, -1, -1):
        v = queue[k]
        if level[v] == middle and _reaches(v, middle + 1, level, ptr, cols, tptr, trow):
            end -= 1
            order[end] = v
    at = end
    for k in range(found - 1, -1, -1):
        if level[queue[k]] > middle:
            at -= 1
            order[at] = queue[k]
    for k in range(found):
        v = queue[k]
        if level[v] < middle or (
            level[v] == middle and not _reaches(v, middle + 1, level, ptr, cols, tptr, trow)
        ):
            order[mid] = v
            mid += 1
    return mid, end


@inner_kernel
def _sort_ascending(a, n):
    """Sort a[:n] in place (Shell 1959, gaps of Ciura 2001)."""
    for gap in (301, 132, 57, 23, 10, 4, 1):
        for k in range(gap, n):
            v = a[k]
            at = k
            while at >= gap and a[at - gap] > v:
                a[at] = a[at - gap]
                at -= gap
            a[at] = v


@inner_kernel
def _borders(first, above, place, order, ptr, cols, tptr, trow):
    """Find for every part the places behind it that it or the parts below it meet.

    Returns up (parts,): the part above each; of (n,): the part of each place; bptr (parts + 1,) and
    border: those places, ascending.
    """
    # Symbolic elimination: a part meets its neighbours, and what the parts below it have met.
    parts = first.size - 1
    n = order.size
    up = np.full(parts, -1)
    of = np.empty(n, np.int64)
    for s in range(parts):
        for c in range(first[s], first[s + 1]):
            of[c] = s
    bptr = np.zeros(parts + 1, np.int64)
    border = np.empty(8 * n + 64, np.int64)
    mark = np.full(n, -1)
    below = np.full(parts, -1)
    sibling = np.full(parts, -1)
    found = np.empty(n, np.int64)
    for s in range(parts):
        if above[first[s]] >= 0:
            up[s] = of[above[first[s]]]
        m = 0
        end = first[s + 1]
        for c in range(first[s], end):
            v = order[c]
            for f in range(tptr[v], tptr[v + 1]):
                for e in range(ptr[trow[f]], ptr[trow[f] + 1]):
                    u = place[cols[e]]
                    if u >= end and mark[u] != s:
                        mark[u] = s
                        found[m] = u
                        m += 1
        child = below[s]
        while child >= 0:
            for e in range(bptr[child], bptr[child + 1]):
                u = border[e]
                if u >= end and mark[u] != s:
                    mark[u] = s
                    found[m] = u
                    m += 1
            child = sibling[child]
        _sort_ascending(found, m)
        if bptr[s] + m > border.size:
            old = border
            border = np.empty(2 * (bptr[s] + m), np.int64)
            for e in range(bptr[s]):
                border[e] = old[e]
        for e in range(m):
            border[bptr[s] + e] = found[e]
        bptr[s + 1] = bptr[s] + m
        if up[s] >= 0:
            sibling[s] = below[up[s]]
            below[up[s]] = s
    return up, of, bptr, border


@inner_kernel
def assembly_tree(
    ptr: np.ndarray, cols: np.ndarray, tptr: np.ndarray, trow: np.ndarray
) -> AssemblyTree:
    """Return the AssemblyTree of a CSR pattern ptr (m + 1,), cols (e,).

    tptr (n + 1,), trow (e,): its transpose.
    """
    n = tptr.size - 1
    order, above = nested_dissection(ptr, cols, tptr, trow)
    # Places of the coordinates, and the parts: each begins where `above` is set.
    place = np.empty(n, np.int64)
    parts = 0
    for c in range(n):
        place[order[c]] = c
        parts += above[c] > -2
    first = np.empty(parts + 1, np.int64)
    s = 0
    for c in range(n):
        if above[c] > -2:
            first[s] = c
            s += 1
    first[parts] = n
    up, of, bptr, border = _borders(first, above, place, order, ptr, cols, tptr, trow)
    rel, panel, sizes = _front_layout(first, up, bptr, border)
    optr, orow, loc = _row_owners(first, of, bptr, border, place, ptr, cols)
    return AssemblyTree(order, first, up, bptr, border, rel, panel, optr, orow, loc, sizes)


@inner_kernel
def _front_layout(first, up, bptr, border):
    """Return rel, panel and sizes of an AssemblyTree."""
    parts = first.size - 1
    rel = np.empty(bptr[parts], np.int64)
    panel = np.zeros(parts + 1, np.int64)
    size = 0
    room = 0
    most = 0
    held = np.zeros(parts, np.int64)
    # a part frees what its children have handed up, and hands up the rest of its own front
    for s in range(parts):
        own = first[s + 1] - first[s]
        far = bptr[s + 1] - bptr[s]
        panel[s + 1] = panel[s] + own * (own + far)
        size = max(size, own + far)
        room += far * far - held[s]
        most = max(most, room + held[s])
        if up[s] >= 0:
            u = up[s]
            held[u] += far * far
            at = bptr[u]
            wide = first[u + 1] - first[u]
            for e in range(bptr[s], bptr[s + 1]):
                if border[e] < first[u + 1]:
                    rel[e] = border[e] - first[u]
                    continue
                while border[at] < border[e]:
                    at += 1
                rel[e] = wide + at - bptr[u]
    return rel, panel, np.array([size, most])


@inner_kernel
def _row_owners(first, of, bptr, border, place, ptr, cols):
    """Assign each row to the front of its first coordinate; returns optr, orow and loc of an
    AssemblyTree."""
    m = ptr.size - 1
    parts = first.size - 1
    owner = np.empty(m, np.int64)
    optr = np.zeros(parts + 1, np.int64)
    loc = np.empty(cols.size, np.int64)
    orow = np.empty(m, np.int64)
    # The first coordinate of a row to be eliminated decides where the row is assembled.
    for k in range(m):
        low = place[cols[ptr[k]]]
        for e in range(ptr[k], ptr[k + 1]):
            low = min(low, place[cols[e]])
        s = of[low]
        owner[k] = s
        optr[s + 1] += 1
        for e in range(ptr[k], ptr[k + 1]):
            u = place[cols[e]]
            if u < first[s + 1]:
                loc[e] = u - first[s]
                continue
            # bisection in the border
            a = bptr[s]
            b = bptr[s + 1]
            while b - a > 1:
                c = (a + b) // 2
                if border[c] <= u:
                    a = c
                else:
                    b = c
            loc[e] = first[s + 1] - first[s] + a - bptr[s]
    for s in range(parts):
        optr[s + 1] += optr[s]
    fill = np.empty(parts, np.int64)
    for s in range(parts):
        fill[s] = optr[s]
    for k in range(m):
        orow[fill[owner[k]]] = k
        fill[owner[k]] += 1
    return optr, orow, loc
