"""Multipliers of contacts by their unit gradients: damped Gram systems, factored in their envelope.

A gradient has few entries, mostly of one or two particles: row k of the gradients at a state has
count[k] entries V[k, e] in the columns C[k, e]. Arrays V (K, m, w) of K states that have the same
gradients hold them once, K = 1.
"""

import numpy as np

from nsbench.compilation.decorators import inner_kernel, njit
from nsbench.linalg.skyline_cholesky import EnvelopePlan, arrange, factor, fill, solve

# Relative to the diagonal of the Gram matrix of unit gradients: contacts that are dependent up to
# this are closed as one, not each for itself.
DAMPING = 1e-10
RAISES = 6  # times that the damping is tried, a hundred times as large each, until a factor exists


@inner_kernel
def add_multiplied(
    C: np.ndarray, V: np.ndarray, count: np.ndarray, m: int, q: np.ndarray, out: np.ndarray
) -> None:
    """Add N^T q to out (n,), for q (m,) and the unit gradients of one state."""
    for k in range(m):
        for e in range(count[k]):
            out[C[k, e]] += V[k, e] * q[k]


@inner_kernel
def times_row(C: np.ndarray, V: np.ndarray, count: np.ndarray, k: int, d: np.ndarray) -> float:
    """Return row k of N d, for d (n,) and the unit gradients of one state."""
    s = 0.0
    for e in range(count[k]):
        s += V[k, e] * d[C[k, e]]
    return s


@inner_kernel
def _factor_gram(plan, C, V, count, m, zeros, E):
    """Fill E with the factor of N N^T + DAMPING, or of more damping if that is not positive.

    zeros (n,): zeros, which it leaves. Gradients that are no numbers have none, nor has E.
    """
    _, _, ends, _, _ = plan
    damping = DAMPING
    for _ in range(RAISES):
        fill(plan, C, V, count, m, zeros, E)
        for i in range(m):
            E[ends[i + 1] - 1] += damping
        if factor(plan, m, E, 0.0):
            return
        damping *= 100.0
    E[:] = np.nan


@inner_kernel
def _solved(plan, C, V, count, m, n, E, is_refined, g, q):
    """Fill q (m,) with the solution for g (m,), by the factor E; is_refined: with one step of
    iterative refinement against N N^T without damping."""
    solve(plan, m, E, g, q)
    if not is_refined:
        return
    along = np.zeros(n)
    add_multiplied(C, V, count, m, q, along)
    lack = np.empty(m)
    for k in range(m):
        lack[k] = g[k] - times_row(C, V, count, k, along)
    solve(plan, m, E, lack, lack)
    for k in range(m):
        q[k] += lack[k]


@inner_kernel
def solve_gram(
    plan: EnvelopePlan,
    C: np.ndarray,
    V: np.ndarray,
    count: np.ndarray,
    n: int,
    g: np.ndarray,
    is_refined: bool,
    q: np.ndarray,
) -> None:
    """Fill q (m,) with the solution of (N N^T + DAMPING) q = g, for g (m,); one state.

    plan: of the Gram matrix (skyline_cholesky.arrange). C, V (m, w), count (m,): unit gradients in
    n coordinates. is_refined: with one step of iterative refinement against N N^T.
    """
    m = len(C)
    _, _, ends, _, _ = plan
    E = np.empty(ends[m])
    _factor_gram(plan, C, V, count, m, np.zeros(n), E)
    _solved(plan, C, V, count, m, n, E, is_refined, g, q)


@njit(cache=True, error_model="numpy")
def gram_multipliers(
    C: np.ndarray,
    V: np.ndarray,
    count: np.ndarray,
    n: int,
    g: np.ndarray,
    is_refined: bool,
    q: np.ndarray,
) -> None:
    """Fill q (K, m) with the solutions of (N N^T + DAMPING) q = g, for g (K, m); K states.

    V (K or 1, m, w): the rest as in solve_gram.
    """
    m = len(C)
    plan = arrange(C, count, m, n)
    _, _, ends, _, _ = plan
    E = np.empty(ends[m])
    zeros = np.zeros(n)
    for s in range(len(g)):
        at = s if len(V) > 1 else 0
        if at == s:
            _factor_gram(plan, C, V[at], count, m, zeros, E)
        _solved(plan, C, V[at], count, m, n, E, is_refined, g[s], q[s])


@njit(cache=True, error_model="numpy")
def times(C: np.ndarray, V: np.ndarray, count: np.ndarray, d: np.ndarray, out: np.ndarray) -> None:
    """Fill out (K, m) with N d, for d (K, n) and unit gradients as in gram_multipliers."""
    for s in range(len(d)):
        at = s if len(V) > 1 else 0
        for k in range(len(C)):
            out[s, k] = times_row(C, V[at], count, k, d[s])


@njit(cache=True, error_model="numpy")
def add_back(
    C: np.ndarray, V: np.ndarray, count: np.ndarray, q: np.ndarray, out: np.ndarray
) -> None:
    """Add N^T q to out (K, n), for q (K, m) and unit gradients as in gram_multipliers."""
    for s in range(len(q)):
        add_multiplied(C, V[s if len(V) > 1 else 0], count, len(C), q[s], out[s])


@inner_kernel
def shortest(
    plan: EnvelopePlan,
    C: np.ndarray,
    V: np.ndarray,
    count: np.ndarray,
    g: np.ndarray,
    is_refined: bool,
    out: np.ndarray,
) -> None:
    """Fill out (n,) with the shortest d with N d = g, for g (m,); arguments as in solve_gram."""
    q = np.empty(len(C))
    solve_gram(plan, C, V, count, len(out), g, is_refined, q)
    out[:] = 0.0
    add_multiplied(C, V, count, len(C), q, out)
