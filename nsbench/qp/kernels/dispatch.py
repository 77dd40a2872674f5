"""A step's least-distance problem by one of two C functions, so that a time loop is compiled
without them.

`exact` (kernels.few) where few rows are at work, `many` (kernels.many) beyond, and `exact` from
where it has come if it gives up. Both fill mu (m,), d = G^T mu (n,) and work (4,): code, rounds,
and for `many` the sizes that book and store must have; it answers GROW when they are smaller, and
nothing is solved.
"""

import numpy as np
from numba import float64, int64, void

from nsbench.compilation.decorators import cfunc, njit
from nsbench.qp.kernels.active_set import arrange

FEW = 128  # rows at work; below, one round of the active set costs less than three rounds on fronts
GROW = 5
GIVEN_UP = 6
_I = int64[::1]
_F = float64[::1]
_PROBLEM = (
    _I,
    _I,
    _I,
    _I,
    _I,
    _I,
    _F,
    _F,
    _F,
    float64,
)  # the six of qp.pattern, vals, q, guess, scale
EXACT = void(*_PROBLEM, _F, _F, _I)
MANY = void(*_PROBLEM, _I, _F, _F, _F, _I)


@cfunc(MANY, cache=True)
def no_large_solver(
    ptr, cols, tptr, trow, tpos, order, vals, q, guess, scale, book, store, mu, d, work
):
    """For scenes that never have many rows: gives up, and spares the compilation."""
    work[0] = GIVEN_UP
    work[1] = 0


@njit(cache=True, error_model="numpy")
def rows_at_work(q, guess):
    """Rows that are violated or have a multiplier to begin with."""
    count = 0
    for k in range(q.size):
        count += q[k] < 0.0 or guess[k] > 0.0
    return count


@njit(cache=True, error_model="numpy")
def solve_projection(exact, many, P, book, store, vals, q, guess, scale, work):
    """mu (m,), d = G^T mu (n,), and book and store, perhaps larger ones; work (4,): code and
    rounds."""
    ptr, cols, tptr, trow, tpos, order = P
    mu = np.zeros(q.size)
    d = np.zeros(tptr.size - 1)
    done = 0
    start = guess
    if rows_at_work(q, guess) > FEW:
        many(ptr, cols, tptr, trow, tpos, order, vals, q, guess, scale, book, store, mu, d, work)
        while work[0] == GROW:  # with room to spare: the next list will be as long
            if work[2] > book.size:
                book = np.zeros(work[2] + work[2] // 4, np.int64)
            else:
                store = np.empty(work[3] + work[3] // 4)
            many(
                ptr, cols, tptr, trow, tpos, order, vals, q, guess, scale, book, store, mu, d, work
            )
        if work[0] != GIVEN_UP:
            return mu, d, book, store
        done = work[1]
        start = mu.copy() if done > 0 else guess
    arrange(P)
    exact(ptr, cols, tptr, trow, tpos, order, vals, q, start, scale, mu, d, work)
    work[1] += done
    return mu, d, book, store
