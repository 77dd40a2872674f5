"""Coordinates cut into parts by nested dissection: the tree of fronts on which kernels.fronts
factors I + G^T W G.

Two coordinates are neighbours if a row of G uses both. A part is split by the middle level of a
breadth-first search; the level comes last and is a part of its own, so nothing in front of it meets
anything behind it, whatever the weights of the rows are: the tree depends on where G has entries
only. Source: George & Liu, Computer Solution of Large Sparse Positive Definite Systems, 1981,
section 8; fronts: Duff & Reid, ACM TOMS 9(3), 1983.
"""

import numpy as np

from nsbench.compilation.decorators import njit
from nsbench.linalg.sparse_ldl import levels

# at most this part of the coordinates on one side of a cut; the smallest level is taken
BALANCE = 0.6
LEAF = 32  # coordinates of a part that is not cut any more: dense loops are faster there


@njit(cache=True, error_model="numpy")
def _reaches(v, up, level, ptr, cols, tptr, trow):
    """Whether coordinate v has a neighbour of that level."""
    for f in range(tptr[v], tptr[v + 1]):
        for e in range(ptr[trow[f]], ptr[trow[f] + 1]):
            if level[cols[e]] == up:
                return True
    return False


@njit(cache=True, error_model="numpy")
def _thinnest(queue, level, found):
    """The smallest level that leaves no more than BALANCE of the part on either side."""
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


@njit(cache=True, error_model="numpy")
def _pieces(ptr, cols, tptr, trow, order, label, queue, level, todo):
    """Coordinates that hang together side by side in `order`, small pieces in common parts; returns
    parts, last label."""
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


@njit(cache=True, error_model="numpy")
def nested_dissection(ptr, cols, tptr, trow):
    """Order of elimination (n,), and above (n,): -2 inside a part, else the place where the part
    above it begins (-1: none)."""
    n = tptr.size - 1
    order = np.empty(n, np.int64)
    label = np.ones(n, np.int64)
    above = np.full(n, -2)
    queue = np.empty(n, np.int64)
    level = np.full(n, -1)
    todo = np.empty((n + 1, 3), np.int64)
    depth, part = _pieces(ptr, cols, tptr, trow, order, label, queue, level, todo)
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
        if found < hi - lo and hi - lo > LEAF:  # a part of its own, then the rest
            for k in range(found):
                label[queue[k]] = 0
            for k in range(lo, hi):
                if label[order[k]] != 0:
                    queue[found] = order[k]
                    found += 1
            for k in range(found):
                order[lo + k] = queue[k]
        elif found == hi - lo and found > LEAF and 0 < middle < last:
            mid = lo  # before the level, behind it, and the level last
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


@njit(cache=True, error_model="numpy")
def _ascending(a, n):
    """Sort a[:n] in place (Shell 1959, gaps of Ciura 2001)."""
    for gap in (301, 132, 57, 23, 10, 4, 1):
        for k in range(gap, n):
            v = a[k]
            at = k
            while at >= gap and a[at - gap] > v:
                a[at] = a[at - gap]
                at -= gap
            a[at] = v


@njit(cache=True, error_model="numpy")
def _borders(first, above, place, order, ptr, cols, tptr, trow):
    """For every part the places behind it that it or the parts below it meet, ascending (bptr,
    border); the parts above."""
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
        _ascending(found, m)
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


@njit(cache=True, error_model="numpy")
def assembly_tree(ptr, cols, tptr, trow):
    """The fronts of a pattern: a tuple of arrays that kernels.fronts reads.

    order (n,): coordinate at each place; first (parts + 1,): places of a part; up: the part above;
    bptr, border: places behind a part that its front holds too; rel: where those lie in the front
    above; panel (parts + 1,): where its rows of the factor begin; owner rows: optr (parts + 1,),
    orow; loc: place of each entry of G in the owner's front;
    size: largest front, and room for the stack of what children hand up.
    """
    n = tptr.size - 1
    order, above = nested_dissection(ptr, cols, tptr, trow)
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
    rel = np.empty(bptr[parts], np.int64)
    panel = np.zeros(parts + 1, np.int64)
    size = 0
    room = 0
    most = 0
    held = np.zeros(parts, np.int64)
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
    optr, orow, loc = _owners(first, of, bptr, border, place, ptr, cols)
    return order, first, up, bptr, border, rel, panel, optr, orow, loc, np.array([size, most])


@njit(cache=True, error_model="numpy")
def _owners(first, of, bptr, border, place, ptr, cols):
    """Each row belongs to the front of its first coordinate; where its entries lie there."""
    m = ptr.size - 1
    parts = first.size - 1
    owner = np.empty(m, np.int64)
    optr = np.zeros(parts + 1, np.int64)
    loc = np.empty(cols.size, np.int64)
    orow = np.empty(m, np.int64)
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
