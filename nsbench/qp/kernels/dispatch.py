"""Choose the solver of a projection QP by its active rows: few (active set) or many (sparse).

Both are C callbacks, so that a time loop is compiled without them.

`exact` (qp.kernels.active_set_callback) where few rows are at work; `large`
(qp.kernels.large_callback) beyond, and `exact` from where that has come if it gives up. Both fill
mu (m,), d = G^T mu (n,) and work (WORK,): CODE and ROUNDS, and for `large` the sizes TREE_SIZE and
WORK_SIZE that tree_buffer and work_buffer must have; it answers GROW when they are smaller, and
nothing is solved then.
"""

from __future__ import annotations

import numpy as np
from numba import float64, int64, void

from nsbench.compilation.decorators import cfunc, inner_kernel, njit
from nsbench.qp.kernels.active_set import order_rows

# rows at work; below, one round of the active set costs less than three rounds on fronts
SMALL_PROBLEM = 128
# codes beside SOLVED, INFEASIBLE and MAXITER of dual_active_set
GROW = 5
GIVEN_UP = 6
# indices of `work`
CODE = 0
ROUNDS = 1
TREE_SIZE = 2
WORK_SIZE = 3
WORK = 4
_I = int64[::1]
_F = float64[::1]
_PATTERN = (_I, _I, _I, _I, _I, _I)  # the arrays of a SparsityPattern
_PROBLEM = (*_PATTERN, _F, _F, _F, float64)  # vals, q, guess, scale
_ANSWER = (_F, _F, _I)  # mu, d, work
EXACT_SIGNATURE = void(*_PROBLEM, *_ANSWER)
LARGE_SIGNATURE = void(*_PROBLEM, _I, _F, *_ANSWER)


@cfunc(LARGE_SIGNATURE, cache=True)
def no_large_solver(
    ptr: np.ndarray,
    cols: np.ndarray,
    tptr: np.ndarray,
    trow: np.ndarray,
    tpos: np.ndarray,
    order: np.ndarray,
    vals: np.ndarray,
    q: np.ndarray,
    guess: np.ndarray,
    scale: float,
    tree_buffer: np.ndarray,
    work_buffer: np.ndarray,
    mu: np.ndarray,
    d: np.ndarray,
    work: np.ndarray,
) -> None:
    """Give up: for scenes that never have many rows, which are spared the compilation."""
    work[CODE] = GIVEN_UP
    work[ROUNDS] = 0


@inner_kernel
def rows_at_work(q: np.ndarray, guess: np.ndarray) -> int:
    """Count the rows of q, guess (m,) that are violated or have a multiplier to begin with."""
    count = 0
    for k in range(q.size):
        count += q[k] < 0.0 or guess[k] > 0.0
    return count


@njit(cache=True, error_model="numpy")
def solve_projection(exact, large, P, tree_buffer, work_buffer, vals, q, guess, scale, work):
    """Solve min 1/2 |d|^2 s.t. q + G d >= 0 by the callback `exact` or `large`.

    P, vals: pattern and entries of G (m, n); q, guess (m,); scale: size of the numbers the gaps are
    made of. Returns mu (m,), d = G^T mu (n,), and the two buffers, perhaps larger ones; fills work
    (WORK,).
    """
    ptr, cols, tptr, trow, tpos, order = P
    mu = np.zeros(q.size)
    d = np.zeros(tptr.size - 1)
    done = 0
    start = guess
    if rows_at_work(q, guess) > SMALL_PROBLEM:
        large(
            ptr,
            cols,
            tptr,
            trow,
            tpos,
            order,
            vals,
            q,
            guess,
            scale,
            tree_buffer,
            work_buffer,
            mu,
            d,
            work,
        )
        while work[CODE] == GROW:  # by a quarter more: the next list will be about as long
            if work[TREE_SIZE] > tree_buffer.size:
                tree_buffer = np.zeros(work[TREE_SIZE] + work[TREE_SIZE] // 4, np.int64)
            else:
                work_buffer = np.empty(work[WORK_SIZE] + work[WORK_SIZE] // 4)
            large(
                ptr,
                cols,
                tptr,
                trow,
                tpos,
                order,
                vals,
                q,
                guess,
                scale,
                tree_buffer,
                work_buffer,
                mu,
                d,
                work,
            )
        if work[CODE] != GIVEN_UP:
            return mu, d, tree_buffer, work_buffer
        done = work[ROUNDS]
        start = mu.copy() if done > 0 else guess
    order_rows(P)
    exact(ptr, cols, tptr, trow, tpos, order, vals, q, start, scale, mu, d, work)
    work[ROUNDS] += done
    return mu, d, tree_buffer, work_buffer
