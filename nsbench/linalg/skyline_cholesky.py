"""Skyline (envelope) Cholesky factorisation of Gram matrices G G^T: ordering, factor, solves.

The rows of G are short: row k has count[k] entries, in the columns C[k] with the values V[k]. They
are ordered by Cuthill & McKee (1969) on the graph of contacts that share a coordinate,
component by component, so that a matrix of many small clusters, or of one flat cluster, has a short
envelope; the factor fills only that envelope (George & Liu 1981, chapter 4). Row i of the ordered
matrix is stored from its first entry to its diagonal.
"""

import numpy as np

from nsbench.compilation.decorators import inner_kernel, summing_kernel

# place (p,), start (p,), pointers (p + 1,), and the rows that share a column: nptr (p + 1,), near
EnvelopePlan = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@inner_kernel
def columns(C: np.ndarray, count: np.ndarray, p: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of each column: pointers (n + 1,) and members (e,).

    C (p, width), count (p,): columns of the rows. Counting sort by column.
    """
    ptr = np.zeros(n + 1, np.int64)
    for k in range(p):
        for e in range(count[k]):
            ptr[C[k, e] + 1] += 1
    for c in range(n):
        ptr[c + 1] += ptr[c]
    fill = ptr[:n].copy()
    member = np.empty(ptr[n], np.int64)
    for k in range(p):
        for e in range(count[k]):
            member[fill[C[k, e]]] = k
            fill[C[k, e]] += 1
    return ptr, member


@inner_kernel
def _breadth(first, nptr, near, stamp, mark, queue, at):
    """Write the rows reached from `first` to queue[at:], in breadth-first order; returns the
    end."""
    queue[at] = first
    stamp[first] = mark
    head = at
    end = at + 1
    while head < end:
        k = queue[head]
        head += 1
        for u in range(nptr[k], nptr[k + 1]):
            if stamp[near[u]] != mark:
                stamp[near[u]] = mark
                queue[end] = near[u]
                end += 1
    return end


@inner_kernel
def _neighbours(C, count, p, n, stamp):
    """Return the rows that share a column with each row, itself included: pointers (p + 1,) and
    members."""
    ptr, member = columns(C, count, p, n)
    nptr = np.zeros(p + 1, np.int64)
    most = 0
    m = 0
    for k in range(p):
        stamp[k] = -1
        for e in range(count[k]):
            most += ptr[C[k, e] + 1] - ptr[C[k, e]]
    near = np.empty(most, np.int64)
    for k in range(p):
        for e in range(count[k]):
            for u in range(ptr[C[k, e]], ptr[C[k, e] + 1]):
                j = member[u]
                if stamp[j] != k:
                    stamp[j] = k
                    near[m] = j
                    m += 1
        nptr[k + 1] = m
    return nptr, near


@inner_kernel
def arrange(C: np.ndarray, count: np.ndarray, p: int, n: int) -> EnvelopePlan:
    """Plan the factorisation: order the rows by Cuthill & McKee, reversed.

    C (p, width), count (p,): columns of the p rows; n: number of columns.
    Returns the plan: place (p,) of each row, start (p,) and pointers (p + 1,) of the envelope, and
    the rows that share a column with each row, nptr (p + 1,) and near.
    """
    queue = np.empty(p, np.int64)
    stamp = np.empty(p, np.int64)
    at = np.int64(0)
    mark = np.int64(p)
    nptr, near = _neighbours(C, count, p, n, stamp)
    done = np.zeros(p, np.bool_)
    # Reverse Cuthill-McKee: breadth-first from a nearly peripheral row of each component, the last
    # row that a first search reaches.
    for k in range(p):
        if not done[k]:
            end = _breadth(k, nptr, near, stamp, mark + 1, queue, at)
            end = _breadth(queue[end - 1], nptr, near, stamp, mark + 2, queue, at)
            mark += 2
            for u in range(at, end):
                done[queue[u]] = True
            at = end
    place = np.empty(p, np.int64)
    start = np.empty(p, np.int64)
    eptr = np.zeros(p + 1, np.int64)
    for u in range(p):
        place[queue[u]] = p - 1 - u
    # Envelope: a row begins at the first of its neighbours.
    for k in range(p):
        first = place[k]
        for u in range(nptr[k], nptr[k + 1]):
            first = min(first, place[near[u]])
        start[place[k]] = first
    for i in range(p):
        eptr[i + 1] = eptr[i] + i - start[i] + 1
    return place, start, eptr, nptr, near


@inner_kernel
def fill(
    plan: EnvelopePlan,
    C: np.ndarray,
    V: np.ndarray,
    count: np.ndarray,
    p: int,
    work: np.ndarray,
    E: np.ndarray,
) -> None:
    """Fill E with the Gram matrix G G^T, in the envelope of the plan.

    plan: of `arrange`. C, V (p, longest row), count (p,): columns, values and lengths of the rows
    of G. E (eptr[p],): row i of the ordered matrix begins at eptr[i] with its entry start[i]; what
    no two rows share stays zero. work (n,): zeros, which it leaves.

    Row k is scattered to `work` once, so that its product with a row that shares a column with it
    costs the entries of that row. Only places up to the diagonal are stored, as the matrix is
    symmetric.
    """
    place, start, eptr, nptr, near = plan
    E[:] = 0.0
    # Scatter row k into a dense vector, multiply by its neighbours, clear it again.
    for k in range(p):
        i = place[k]
        for e in range(count[k]):
            work[C[k, e]] += V[k, e]  # a column may be listed twice
        for u in range(nptr[k], nptr[k + 1]):
            j = near[u]
            s = 0.0
            if place[j] <= i:
                for e in range(count[j]):
                    s += V[j, e] * work[C[j, e]]
                E[eptr[i] + place[j] - start[i]] = s
        for e in range(count[k]):
            work[C[k, e]] = 0.0


@summing_kernel
def _dot(E, a, b, m):
    s = 0.0
    for k in range(m):
        s += E[a + k] * E[b + k]
    return s


@inner_kernel
def factor(plan: EnvelopePlan, p: int, E: np.ndarray, least: float) -> bool:
    """Replace E (e,), the envelope of a matrix, by its Cholesky factor.

    Returns False if a pivot is not above `least` times its diagonal.
    """
    _, start, eptr, _, _ = plan
    # Cholesky's method by rows: both factors of a dot product are stretches of the envelope.
    for i in range(p):
        row = eptr[i]
        a = start[i]
        for j in range(a, i):
            b = max(a, start[j])
            s = E[row + j - a] - _dot(E, row + b - a, eptr[j] + b - start[j], j - b)
            E[row + j - a] = s / E[eptr[j + 1] - 1]
        d = E[row + i - a]
        s = d - _dot(E, row, row, i - a)
        if not s > least * d:
            return False
        E[row + i - a] = np.sqrt(s)
    return True


@summing_kernel
def solve(plan: EnvelopePlan, p: int, E: np.ndarray, v: np.ndarray, out: np.ndarray) -> None:
    """Fill out (p,) with (L L^T)^-1 v, v (p,), both in the order of the rows of G; E holds L.

    v and out may be the same array.
    """
    place, start, eptr, _, _ = plan
    y = np.empty(p)
    for k in range(p):
        y[place[k]] = v[k]
    # Forward substitution by rows, then backward substitution by columns of L^T.
    for i in range(p):
        row = eptr[i]
        a = start[i]
        s = y[i]
        for j in range(a, i):
            s -= E[row + j - a] * y[j]
        y[i] = s / E[row + i - a]
    for i in range(p - 1, -1, -1):
        row = eptr[i]
        a = start[i]
        y[i] /= E[row + i - a]
        for j in range(a, i):
            y[j] -= E[row + j - a] * y[i]
    for k in range(p):
        out[k] = y[place[k]]
