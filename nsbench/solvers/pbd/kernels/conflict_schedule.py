"""Order of execution of a sweep in which neighbours in the list seldom share a particle.

Two constraints that share no particle may change places without changing a bit. So each particle
sorts its own constraints by key, and each constraint waits for its predecessors in those short
lists (a dependency graph); every topological order gives the bits of the stated order. The one
taken here goes through the store band by band, a band being some rows of cells: of all constraints
that wait for nothing any more, next is the one that has been so longest in the lowest band. What
follows in the list then seldom waits for one another, as a band advances at many places in turn,
and yet is near in memory.
"""

import numpy as np

from nsbench.compilation.decorators import inner_kernel

BAND_ROWS = 8  # rows of cells in a band: about the projections a processor keeps under way at once


@inner_kernel
def sort_by_key(ids: np.ndarray, lo: int, hi: int, keys: np.ndarray) -> None:
    """Sort ids[lo:hi] by ascending keys (m,) (Shell's sort: the lists are short, seldom long)."""
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


@inner_kernel
def build_dependencies(
    i: np.ndarray,
    j: np.ndarray,
    keys: np.ndarray,
    ends: np.ndarray,
    ids: np.ndarray,
    after: np.ndarray,
    need: np.ndarray,
) -> None:
    """Build the dependency graph of the constraints i, j (m,) with keys (m,).

    Fills after (2 m,) with the next constraint at either particle (-1: none) and need (m,) with how
    many constraints one waits for. ends (n + 1,), ids (2 m,): work arrays.
    """
    # Counting sort: the constraints of each particle, one stretch after the other.
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
    # In the order of the sweep each constraint of a particle waits for the one before it.
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


@inner_kernel
def _enqueue(c, u, first, last, behind):
    """Append constraint c to the queue of band u."""
    if first[u] < 0:
        first[u] = c
    else:
        behind[last[u]] = c
    behind[c] = -1
    last[u] = c


@inner_kernel
def schedule(
    i: np.ndarray,
    j: np.ndarray,
    keys: np.ndarray,
    row: np.ndarray,
    ends: np.ndarray,
    ids: np.ndarray,
    after: np.ndarray,
    need: np.ndarray,
    place: np.ndarray,
) -> None:
    """Fill place (m,) with the places of the constraints in the order of execution.

    i, j (m,): particles (j < 0: on i alone); keys (m,) of the stated order; row (n,): row of the
    cell of each particle. ends (n + 1,), ids, after (2 m,), need (m,): work arrays.
    """
    build_dependencies(i, j, keys, ends, ids, after, need)
    bands = 1
    for s in range(row.size):
        bands = max(bands, row[s] // BAND_ROWS + 1)
    first = np.full(bands, -1, np.int32)
    last = np.empty(bands, np.int32)
    behind = ids  # the queues of the bands as linked lists
    for c in range(i.size):
        if need[c] == 0:
            _enqueue(c, row[i[c]] // BAND_ROWS, first, last, behind)
    # topological order by Kahn's algorithm, with one queue per band
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
                    u = row[i[q]] // BAND_ROWS
                    _enqueue(q, u, first, last, behind)
                    at = min(at, u)
