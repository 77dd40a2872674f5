"""Many rows as a C function: the active set of the step before revised, or else the interior point,
on the fronts of a list."""

import numpy as np

from nsbench.compilation.decorators import cfunc, njit
from nsbench.linalg.nested_dissection import assembly_tree
from nsbench.linalg.sparse_ldl import lengths
from nsbench.qp.kernels import active_set
from nsbench.qp.kernels.dispatch import GIVEN_UP, GROW, MANY
from nsbench.qp.kernels.interior_point import COLD, NEAR, interior
from nsbench.qp.kernels.working_set_update import update_working_set

TOL = 1e-10  # of the residual, a length
# signs wrong at first, and exchanges: more of them cost more than the interior point
WRONG = 50
SWAPS = 90
HEAD = 16  # of the book: whether it is filled, then where its arrays begin


@njit(cache=True, error_model="numpy")
def _shelve(T, book):
    """The arrays of a tree one after the other in the book, if they fit; returns the size they
    need."""
    size = HEAD
    for a in T:
        size += a.size
    if size > book.size:
        return size
    at = HEAD
    u = 2
    for a in T:
        book[u] = at
        for k in range(a.size):
            book[at + k] = a[k]
        at = at + a.size
        u = u + 1
    book[u] = at
    return size


@njit(cache=True, error_model="numpy")
def _opened(book):
    """The tree in the book."""
    b = book
    return (
        b[b[2] : b[3]],
        b[b[3] : b[4]],
        b[b[4] : b[5]],
        b[b[5] : b[6]],
        b[b[6] : b[7]],
        b[b[7] : b[8]],
        b[b[8] : b[9]],
        b[b[9] : b[10]],
        b[b[10] : b[11]],
        b[b[11] : b[12]],
        b[b[12] : b[13]],
    )


@cfunc(MANY, cache=True, error_model="numpy")
def solve_large(
    ptr, cols, tptr, trow, tpos, order, vals, q, guess, scale, book, store, mu, d, work
):
    """Solve on the tree in the book, made first if book[0] is 0; the caller empties it for a new
    list."""
    if book[0] == 0:
        work[2] = _shelve(assembly_tree(ptr, cols, tptr, trow), book)
        if work[2] > book.size:
            work[0] = GROW
            return
        book[0] = 1
    T = _opened(book)
    size = T[10][0]
    most = T[10][1]
    rows = T[6][T[6].size - 1]
    ends = np.array(
        [
            rows,
            rows + size * size,
            rows + size * size + most + 1,
            rows + size * size + most + 1 + d.size + size,
        ]
    )
    work[3] = ends[3]
    if work[3] > store.size:
        work[0] = GROW
        return
    room = (
        store[: ends[0]],
        store[ends[0] : ends[1]],
        store[ends[1] : ends[2]],
        store[ends[2] : ends[3]],
    )
    P = (ptr, cols, tptr, trow, tpos, order)
    norm = lengths(P, vals)
    unit = np.empty(vals.size)
    least = np.empty(q.size)
    start = np.empty(q.size)
    w = np.empty(q.size)
    fresh = True
    for k in range(q.size):
        for e in range(ptr[k], ptr[k + 1]):
            unit[e] = vals[e] / norm[k]
        least[k], start[k] = q[k] / norm[k], max(guess[k], 0.0) * norm[k]
        fresh = fresh and start[k] == 0.0
        mu[k] = start[k]
    code = 2
    rounds = 0
    if not fresh:
        done, rounds, swaps = update_working_set(
            P, T, room, unit, least, mu, TOL, np.int64(WRONG), np.int64(SWAPS), d, w
        )
        code = 0 if done else 2
        rounds = rounds + swaps
        if swaps > 0:  # what it has won is a better start
            for k in range(q.size):
                start[k] = mu[k]
    if code == 2:
        code, more = interior(
            P, T, room, unit, least, start, scale, TOL, mu, d, w, COLD if fresh else NEAR
        )
        rounds += more
    if code == 2 and not fresh:  # once more from nothing
        for k in range(q.size):
            start[k] = 0.0
        code, more = interior(P, T, room, unit, least, start, scale, TOL, mu, d, w, COLD)
        rounds += more
    for k in range(q.size):
        mu[k] /= norm[k]
    work[0] = active_set.SOLVED if code == 0 else (active_set.INFEASIBLE if code == 1 else GIVEN_UP)
    work[1] = rounds
