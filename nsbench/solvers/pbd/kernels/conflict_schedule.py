"""What of a sweep may run at once: constraints put in an order of execution that gives the bits of
the stated order.

Two constraints that share no particle may change places. So each particle sorts its own constraints
by key, and each constraint waits for its neighbours in those short lists. Any order in which nobody
overtakes whom it waits for does. The one taken here goes through the store band by band, a band
being some rows of cells: of all constraints that wait for nothing any more, next is the one that
has been so longest in the lowest band. What follows in the list then seldom waits for one another,
as a band goes on at many places in turn, and yet is near in memory.
"""

import numpy as np

from nsbench.compilation.decorators import njit

BAND = 8  # rows of cells, as many as chains of projections that a processor has in hand at a time


@njit(cache=True)
def sort_by_key(ids, lo, hi, keys):
    """ids[lo:hi] in ascending order of keys (Shell's sort: the lists are short, seldom long)."""
    gap = 1
    while 3 * gap < hi - lo:
        gap = 3 * gap + 1
    while gap > 0:
        for e in range(lo + gap, hi):
            c = ids[e]
            k = keys[c]
            f = e
            while f - gap >= lo and keys[ids[f - gap]] > k:
                ids[f] = ids[f - gap]
                f -= gap
            ids[f] = c
        gap //= 3


@njit(cache=True)
def waits(i, j, keys, ends, ids, after, need):
    """Fill `after` (2 m,) with the next constraint at either particle (-1: none), `need` (m,) with
    how many a constraint waits for. ends (n + 1,), ids (2 m,): room to work in."""
    n = ends.size - 1
    ends[:] = 0
    for c in range(i.size):
        ends[i[c] + 1] += 1
        if j[c] >= 0:
            ends[j[c] + 1] += 1
    for s in range(n):
        ends[s + 1] += ends[s]
    for c in range(i.size):
        ids[ends[i[c]]] = c
        ends[i[c]] += 1
        if j[c] >= 0:
            ids[ends[j[c]]] = c
            ends[j[c]] += 1
    after[:] = -1
    need[:] = 0
    lo = 0
    for s in range(n):
        hi = ends[s]  # filling has moved each start to its end
        sort_by_key(ids, lo, hi, keys)
        for e in range(lo + 1, hi):
            p = ids[e - 1]
            after[2 * p + (i[p] != s)] = ids[e]
            need[ids[e]] += 1
        lo = hi


@njit(cache=True)
def _join(c, u, first, last, behind):
    """Constraint c at the end of the queue of band u."""
    if first[u] < 0:
        first[u] = c
    else:
        behind[last[u]] = c
    behind[c] = -1
    last[u] = c


@njit(cache=True)
def schedule(i, j, keys, row, ends, ids, after, need, place):
    """Fill `place` (m,) with the places of the constraints in the order of execution.

    i, j (m,): particles (j < 0: on i alone); keys (m,) of the stated order; row (n,) of the
    particles' cells; the rest is room.
    """
    waits(i, j, keys, ends, ids, after, need)
    bands = 1
    for s in range(row.size):
        bands = max(bands, row[s] // BAND + 1)
    first = np.full(bands, -1, np.int32)
    last = np.empty(bands, np.int32)
    behind = ids  # the queues of the bands as linked lists
    for c in range(i.size):
        if need[c] == 0:
            _join(c, row[i[c]] // BAND, first, last, behind)
    done = 0
    at = 0
    while at < bands:
        c = first[at]
        if c < 0:
            at += 1
            continue
        first[at] = behind[c]
        place[c] = done
        done += 1
        for e in range(2 * c, 2 * c + 2):
            q = after[e]
            if q >= 0:
                need[q] -= 1
                if need[q] == 0:
                    u = row[i[q]] // BAND
                    _join(q, u, first, last, behind)
                    at = min(at, u)


@njit(cache=True)
def about(i, j, n, threads, first):
    """Class of a constraint on particles i, j by place: its strip, else its border (behind the
    `threads` strips), else the rest. first: the earliest that may be said (0: strips; else
    borders)."""
    j = i if j < 0 else j
    strip = ((i + 1) * threads - 1) // n
    if first == 0 and strip == ((j + 1) * threads - 1) // n:
        return strip
    border = (((i + 1) * 2 * threads - 1) // n + 1) // 2
    return (
        threads + border
        if border == (((j + 1) * 2 * threads - 1) // n + 1) // 2
        else 2 * threads + 1
    )


@njit(cache=True)
def divide(i, j, after, place, order, kind, n, ends):
    """Sort the order of execution by classes that threads may take: changes `place`, fills `ends`
    with where each begins.

    Of n particles of the store those of a strip lie together; ends (2 threads + 3,): of the strips,
    of the borders from the lowest half strip on to the highest, of the rest. A class waits for
    nothing but earlier ones of its own kind: a strip for none, a border for strips alone. after: as
    `waits` fills it; order, kind: room (m,).
    """
    threads = ends.size // 2 - 1
    last = 2 * threads + 1
    for c in range(i.size):
        order[place[c]] = c
        kind[c] = about(i[c], j[c], n, threads, 0)
    ends[:] = 0
    for e in range(i.size):
        c = order[e]
        ends[kind[c] + 1] += 1
        for u in range(2 * c, 2 * c + 2):
            q = after[u]
            if q >= 0 and kind[c] == last:
                kind[q] = last
            elif q >= 0 and kind[c] >= threads and kind[q] < threads:
                kind[q] = about(i[q], j[q], n, threads, 1)
    for k in range(ends.size - 1):
        ends[k + 1] += ends[k]
    for e in range(i.size):
        c = order[e]
        place[c] = ends[kind[c]]
        ends[kind[c]] += 1
    for k in range(ends.size - 1, 0, -1):  # filling has moved each start to its end
        ends[k] = ends[k - 1]
    ends[0] = 0
