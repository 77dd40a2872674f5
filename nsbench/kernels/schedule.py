"""What of a sweep may run at once: constraints put in an order of execution that gives the bits of the stated order.

Two constraints that share no particle may change places. So each particle sorts its own constraints by key, each
constraint waits for its neighbours in those short lists, and its level is one more than that of the last it waits
for. Any order in which nobody overtakes whom it waits for does; the one taken here is by  row + 2 level,  row that of
the cells of a first particle. Rows of constraints that share a particle differ by at most 1, so this sum grows
from one to the next; constraints of one sum share no particle; and those far apart in the list are far apart in
space: the sweep goes through memory once, and its projections do not wait for one another.
"""
import numpy as np
from numba import njit


@njit(cache=True)
def sort_by_key(ids, lo, hi, keys):
    """ids[lo:hi] in ascending order of keys (Shell's sort: the lists are short, seldom long)."""
    gap = 1
    while 3 * gap < hi - lo:
        gap = 3 * gap + 1
    while gap > 0:
        for e in range(lo + gap, hi):
            c = ids[e]
            k, f = keys[c], e
            while f - gap >= lo and keys[ids[f - gap]] > k:
                ids[f] = ids[f - gap]
                f -= gap
            ids[f] = c
        gap //= 3


@njit(cache=True)
def waits(i, j, keys, ends, ids, after, need):
    """Fill `after` (2 m,) with the next constraint at either particle (-1: none), `need` (m,) with how many a constraint
    waits for. ends (n + 1,), ids (2 m,): room to work in."""
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
        hi = ends[s]                         # filling has moved each start to its end
        sort_by_key(ids, lo, hi, keys)
        for e in range(lo + 1, hi):
            p = ids[e - 1]
            after[2 * p + (i[p] != s)] = ids[e]
            need[ids[e]] += 1
        lo = hi


@njit(cache=True)
def fill_levels(after, need, stack, level):
    """Level of each constraint, from 0; need is used up."""
    level[:] = 0
    for first in range(need.size):
        if need[first] != 0:
            continue
        stack[0], top = first, 1
        need[first] = -1
        while top > 0:
            top -= 1
            c = stack[top]
            for e in range(2 * c, 2 * c + 2):
                q = after[e]
                if q >= 0:
                    level[q] = max(level[q], level[c] + 1)
                    need[q] -= 1
                    if need[q] == 0:
                        need[q] = -1
                        stack[top] = q
                        top += 1


@njit(cache=True)
def schedule(i, j, keys, row, ends, ids, after, need, place):
    """Fill `place` (m,) with the places of the constraints in the order of execution.

    i, j (m,): particles (j < 0: on i alone); keys (m,) of the stated order; row (n,) of the particles' cells; the
    rest is room.
    """
    waits(i, j, keys, ends, ids, after, need)
    fill_levels(after, need, ids, place)
    last = 0
    for c in range(i.size):
        place[c] = row[i[c]] + 2 * place[c]
        last = max(last, place[c])
    count = np.zeros(last + 2, np.int32)
    for c in range(i.size):
        count[place[c] + 1] += 1
    for s in range(last + 1):
        count[s + 1] += count[s]
    for c in range(i.size):
        s = place[c]
        place[c] = count[s]
        count[s] += 1
