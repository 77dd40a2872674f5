"""Matrices of one theta step, and the data of its linear complementarity problem.

W = (I - h th J)^-1,   G = h W B,   M = D + (th I + (1 - th) E) C G,   r: see `offset`
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nsbench.compilation.decorators import inner_kernel, njit
from nsbench.lcp.lemke import scales
from nsbench.linalg.gauss_elimination import solve_gauss


class ComplementaritySystem(NamedTuple):
    """The matrices B (n, m), C (m, n), D (m, m) of the system; fixed (m,): rows without lam."""

    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    fixed: np.ndarray


class StepMatrices(NamedTuple):
    """Matrices of a step, overwritten when they are computed anew and reused between steps.

    J = df/dx; W = (I - h th J)^-1 (n, n); G = h W B (n, m); E (m, m): see the module; M (m, m): of
    the complementarity problem; a, b (m,): its scales.
    """

    J: np.ndarray
    W: np.ndarray
    G: np.ndarray
    E: np.ndarray
    M: np.ndarray
    a: np.ndarray
    b: np.ndarray


@inner_kernel
def times(A: np.ndarray, x: np.ndarray, out: np.ndarray) -> None:
    """Multiply: out <- A x."""
    for i in range(A.shape[0]):
        out[i] = 0.0
        for j in range(A.shape[1]):
            out[i] += A[i, j] * x[j]


@njit(cache=True, error_model="numpy")
def matrices(
    J: np.ndarray, h: float, theta: float, B: np.ndarray, W: np.ndarray, G: np.ndarray
) -> bool:
    """Compute W <- (I - h th J)^-1 and G <- h W B; return False if the matrix is singular."""
    n = J.shape[0]
    K = np.empty((n, n))
    e = np.empty(n)
    for c in range(n):
        for i in range(n):
            e[i] = 1.0 if i == c else 0.0
            for j in range(n):
                K[i, j] = (1.0 if i == j else 0.0) - h * theta * J[i, j]
        if not solve_gauss(K, e):
            return False
        for i in range(n):
            W[i, c] = e[i]
    for i in range(n):
        for j in range(B.shape[1]):
            G[i, j] = 0.0
            for c in range(n):
                G[i, j] += h * W[i, c] * B[c, j]
    return True


@inner_kernel
def rows(
    C: np.ndarray,
    D: np.ndarray,
    G: np.ndarray,
    E: np.ndarray,
    theta: float,
    M: np.ndarray,
    a: np.ndarray,
    b: np.ndarray,
) -> None:
    """Compute M <- D + (th I + (1 - th) E) C G and its row and column scales a, b."""
    m, n = C.shape
    col = np.empty(m)
    for j in range(m):
        for i in range(m):
            col[i] = 0.0
            for c in range(n):
                col[i] += C[i, c] * G[c, j]
        for i in range(m):
            M[i, j] = D[i, j] + theta * col[i]
            for k in range(m):
                M[i, j] += (1.0 - theta) * E[i, k] * col[k]
    one, other = scales(M)
    for i in range(m):
        a[i] = one[i]
        b[i] = other[i]


@inner_kernel
def offset(
    C: np.ndarray,
    E: np.ndarray,
    theta: float,
    x: np.ndarray,
    z: np.ndarray,
    q0: np.ndarray,
    q1: np.ndarray,
    u: np.ndarray,
    v: np.ndarray,
    r: np.ndarray,
) -> None:
    """Compute the constant term r of a step's complementarity problem.

        r <- (1 - th) (C x + q0) + th (C z + q1) + E (1 - th) (C (z - x) + q1 - q0)

    u, v (m,): work.
    """
    times(C, x, u)
    times(C, z, v)
    for i in range(r.size):
        u[i] += q0[i]
        v[i] += q1[i]
        r[i] = (1.0 - theta) * u[i] + theta * v[i]
        u[i] = (1.0 - theta) * (v[i] - u[i])
    for i in range(r.size):
        for k in range(r.size):
            r[i] += E[i, k] * u[k]
