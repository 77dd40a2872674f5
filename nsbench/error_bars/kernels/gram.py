"""Multipliers of many contacts: damped Gram systems, factored in their envelope."""

import numpy as np

from nsbench.compilation.decorators import inner_kernel, njit
from nsbench.linalg.skyline_cholesky import arrange, factor, fill, solve


@inner_kernel
def _entries(N: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the columns (m, width) and counts (m,) of the entries that are not zero in all of the
    matrices N (K, m, n)."""
    K, m, n = N.shape
    count = np.zeros(m, np.int64)
    C = np.zeros((m, n), np.int64)
    for k in range(m):
        for c in range(n):
            for s in range(K):
                if N[s, k, c] != 0.0:
                    C[k, count[k]] = c
                    count[k] += 1
                    break
    return C, count


@inner_kernel
def _lack(C, V, count, m, q, g, along, out):
    """Fill out (m,) with g - G G^T q; along (n,): zeros, which it leaves."""
    for k in range(m):
        for e in range(count[k]):
            along[C[k, e]] += V[k, e] * q[k]
    for k in range(m):
        s = g[k]
        for e in range(count[k]):
            s -= V[k, e] * along[C[k, e]]
        out[k] = s
    for k in range(m):
        for e in range(count[k]):
            along[C[k, e]] = 0.0


@njit(cache=True, error_model="numpy")
def gram_multipliers(
    N: np.ndarray, g: np.ndarray, damping: float, is_refined: bool, q: np.ndarray
) -> bool:
    """Fill q (K, m) with the solutions of (N N^T + damping) q = g, for N (K, m, n) and g (K, m).

    Each row of N has few entries, of one or two particles: the Gram matrices are factored in their
    envelope, which is the same for all K. is_refined: with one step of iterative refinement
    against the matrices without damping. Returns False if a matrix is not positive.
    """
    K, m, n = N.shape
    C, count = _entries(N)
    plan = arrange(C, count, m, n)
    _, _, ends, _, _ = plan
    E = np.empty(ends[m])
    V = np.empty((m, max(1, count.max())))
    zeros = np.zeros(n)
    lack = np.empty(m)
    for s in range(K):
        for k in range(m):
            for e in range(count[k]):
                V[k, e] = N[s, k, C[k, e]]
        fill(plan, C, V, count, m, zeros, E)
        for i in range(m):
            E[ends[i + 1] - 1] += damping
        if not factor(plan, m, E, 0.0):
            return False
        solve(plan, m, E, g[s], q[s])
        if is_refined:
            _lack(C, V, count, m, q[s], g[s], zeros, lack)
            solve(plan, m, E, lack, lack)
            for k in range(m):
                q[s, k] += lack[k]
    return True
