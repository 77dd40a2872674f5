"""Orthonormal columns and rank of small matrices: Gram-Schmidt, and elimination with full pivoting.

Loops stand where numpy would call LAPACK: numba compiles them faster.
"""

import numpy as np

from nsbench.compilation.decorators import inner_kernel


@inner_kernel
def orthonormal(Q: np.ndarray) -> None:
    """Make the columns of Q (p, n) orthonormal in place, by Gram and Schmidt's method done twice
    (Giraud, Langou & Rozloznik, Computers & Mathematics with Applications 50, 2005)."""
    p, n = Q.shape
    # Gram-Schmidt, each column twice: what rounding leaves after the first pass goes in the second.
    for k in range(n):
        for _ in range(2):
            for j in range(k):
                s = 0.0
                for i in range(p):
                    s += Q[i, j] * Q[i, k]
                for i in range(p):
                    Q[i, k] -= s * Q[i, j]
        s = 0.0
        for i in range(p):
            s += Q[i, k] * Q[i, k]
        s = np.sqrt(s)
        for i in range(p):
            Q[i, k] /= s


@inner_kernel
def near_singular(A: np.ndarray, rank: float) -> bool:
    """Does elimination of A (n, n) with full pivoting meet a pivot below `rank` times the first? A
    is overwritten."""
    n = A.shape[0]
    first = 0.0
    # Gaussian elimination with full pivoting: the pivots fall with the singular values.
    for k in range(n):
        p = k
        q = k
        for i in range(k, n):
            for j in range(k, n):
                if abs(A[i, j]) > abs(A[p, q]):
                    p = i
                    q = j
        top = abs(A[p, q])
        if k == 0:
            first = top
        if not top > 1e2 * rank * first:  # elimination overestimates the least singular value
            return True
        for j in range(n):
            A[k, j], A[p, j] = A[p, j], A[k, j]
        for i in range(n):
            A[i, k], A[i, q] = A[i, q], A[i, k]
        for i in range(k + 1, n):
            r = A[i, k] / A[k, k]
            for j in range(k, n):
                A[i, j] -= r * A[k, j]
    return False
