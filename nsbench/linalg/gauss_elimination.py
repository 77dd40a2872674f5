"""Gaussian elimination with partial pivoting, for dense systems of a few unknowns."""

import numpy as np

from nsbench.compilation.decorators import inner_kernel


@inner_kernel
def solve_gauss(A: np.ndarray, b: np.ndarray) -> bool:
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
