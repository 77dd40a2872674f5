"""Small dense vectors and linear systems, and the codes with which time loops end.

The state x (n,) of a time loop is checked by `state_code` and `all_finite`; dense systems of a few
unknowns are solved by Gaussian elimination with partial pivoting.
"""

import enum

import numpy as np

from nsbench.compilation.decorators import njit

LARGEST_STATE = 1e150  # |x_i| beyond which squares may overflow


class StepCode(enum.IntEnum):
    """How a time loop ended; solvers.common.compiled_loop.status_of says it in a sentence."""

    OK = 0
    NAN = 1  # a state, or what it is computed from, is not a number
    BLOWN = 2  # a state exceeds LARGEST_STATE
    TIED = 3  # coincident centres: a contact had no normal
    INFEASIBLE = 4  # the constraints or the complementarity problem of a step have no solution
    UNSOLVED = 5  # no solution of an implicit step was found among the modes tried
    NEWTON_LIMIT = 6  # Newton's method did not converge
    JUMP = 7  # the state would have to jump
    LIST_OVERFLOW = 8  # the candidate lists outgrow their limit


@njit(cache=True)
def state_code(x):
    """Return StepCode.NAN if x (n,) holds a NaN, BLOWN if an entry exceeds 1e150, else OK."""
    for v in x:
        if v != v:
            return StepCode.NAN
    for v in x:
        if abs(v) > LARGEST_STATE:
            return StepCode.BLOWN
    return StepCode.OK


@njit(cache=True)
def all_finite(x):
    """Return whether every entry of x (n,) is below 1e150, so that squares are finite too."""
    for v in x:
        if not abs(v) < LARGEST_STATE:
            return False
    return True


@njit(cache=True)
def largest(x):
    """Return max |x_i| of x (n,), 0 if it is empty."""
    m = 0.0
    for v in x:
        m = max(m, abs(v))
    return m


@njit(cache=True)
def solve_gauss(A, b):
    """Solve A z = b in place (z in b) with partial pivoting.

    A (n, n) is overwritten. Returns False if A is singular or not finite.
    """
    n = b.size
    for j in range(n):
        p = j
        for i in range(j + 1, n):
            if abs(A[i, j]) > abs(A[p, j]):
                p = i
        if not (0.0 < abs(A[p, j]) < np.inf):
            return False
        if p != j:
            for k in range(j, n):
                A[j, k], A[p, k] = A[p, k], A[j, k]
            b[j], b[p] = b[p], b[j]
        for i in range(j + 1, n):
            r = A[i, j] / A[j, j]
            if r != 0.0:
                for k in range(j + 1, n):
                    A[i, k] -= r * A[j, k]
                b[i] -= r * b[j]
    for j in range(n - 1, -1, -1):
        for k in range(j + 1, n):
            b[j] -= A[j, k] * b[k]
        b[j] /= A[j, j]
    return True
