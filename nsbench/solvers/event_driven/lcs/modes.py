"""Reduce a linear complementarity system on a set I of rows with w_I = 0 to a linear flow.

Elsewhere lam = 0.

w_I = 0 is D_II lam + C_I x + q_I = 0. Combinations of its rows without lam constrain the state
alone; they are differentiated, Z (C_I (A x + B_I lam + u) + q_I') = 0, until the matrix that
multiplies lam is regular (index reduction; Kunkel & Mehrmann 2006, chapter 3). Then lam_I = F x +
phi(t) and x' = (A + B_I F) x + B_I phi + u.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.dynamics.lcs import inputs
from nsbench.problem import LCS

ZERO = 1e-12  # of the terms of a sum: below, a coefficient is rounding
RANK = 1e-10  # relative singular value of scaled rows


class Inputs:
    """Evaluate u and q with their derivatives in time, by JAX where any are needed."""

    def __init__(self, p: LCS):
        self._p = p
        self.is_zero = p.u is None and p.q is None
        u, q = inputs(p)
        self._derivatives = [lambda t: np.concatenate((u(t), q(t)))]

    def __call__(self, t: float, order: int) -> np.ndarray:
        """Return (order + 1, n + m): u beside q, their first derivatives below, and so on."""
        if self.is_zero:
            return np.zeros((order + 1, sum(self._p.B.shape)))
        while len(self._derivatives) <= order:
            self._derivatives.append(self._derivative(len(self._derivatives)))
        return np.array([f(t) for f in self._derivatives[: order + 1]])

    def _derivative(self, order):
        """Return the derivative of (u, q) of the given order as a numpy function of time."""
        from nsbench.compilation.factories import as_jax

        p = self._p
        zero = np.zeros(self._p.B.shape)
        u, q = (
            as_jax(f) if f else (lambda t, v=v: v + 0.0 * t)
            for f, v in ((p.u, zero[:, 0]), (p.q, zero[0]))
        )
        import jax
        import jax.numpy as jnp

        f = lambda t: jnp.concatenate((u(t), q(t)))
        for _ in range(order):
            f = jax.jacfwd(f)
        compiled = jax.jit(f)
        return lambda t: np.asarray(compiled(float(t)))


@dataclass(frozen=True, eq=False)
class LcsMode:
    """Linear flow of a linear complementarity system with w = 0 on the rows I.

        lam_I = F x + sum_k Phi[k] s^(k),   x' = G x + sum_k U[k] s^(k),   s = (u, q)

    rows: I, p of them. constraint (c, n), constraint_s (c, order + 1, n + m): constraint x +
    constraint_s s = 0, invariants of the flow. signs (m, n), signs_s: lam on I, w elsewhere. order:
    of the highest derivative of s.
    """

    rows: tuple
    F: np.ndarray
    Phi: np.ndarray
    G: np.ndarray
    U: np.ndarray
    constraint: np.ndarray
    constraint_s: np.ndarray
    signs: np.ndarray
    signs_s: np.ndarray
    order: int


def build_mode(p: LCS, rows: tuple) -> LcsMode | None:
    """Build the mode with w = 0 on `rows`; None if these do not determine lam."""
    on = list(rows)
    n = p.A.shape[0]
    m = p.B.shape[1]
    B = p.B[:, on]
    N = p.D[np.ix_(on, on)]
    K = p.C[on]
    S = np.zeros((len(on), 1, n + m))
    S[np.arange(len(on)), 0, n + np.array(on, int)] = 1.0
    constraint = []
    constraint_s = []
    # Index reduction: rows without lam are differentiated until the matrix N of lam is regular.
    for _ in range(n + 1):
        split = _row_space_and_kernel(N)
        if split is None:
            break
        R, Z = split  # combinations with lam, and those without
        if not Z.shape[0]:
            return _assemble_mode(p, on, N, K, S, constraint, constraint_s)
        Kz = Z @ K
        Sz = np.einsum("ij,jkl->ikl", Z, S)
        size = np.abs(Z) @ np.abs(K)
        if np.any(np.abs(Kz).max(axis=1) <= ZERO * size.max(axis=1)):
            return None  # rows that say the same, or contradict each other
        constraint.append(Kz)
        constraint_s.append(Sz)
        Nz = Kz @ B
        Nz[np.abs(Nz) <= ZERO * (np.abs(Kz) @ np.abs(B))] = 0.0
        S2 = np.zeros((len(Z), S.shape[1] + 1, n + m))
        S2[:, 1:] += Sz
        S2[:, 0, :n] += Kz
        keep = np.zeros((len(R), S.shape[1] + 1, n + m))
        keep[:, :-1] = np.einsum("ij,jkl->ikl", R, S)
        N = np.vstack([R @ N, Nz])
        K = np.vstack([R @ K, Kz @ p.A])
        S = np.concatenate([keep, S2])
    return None


def _row_space_and_kernel(N):
    """Return (R, Z) with R N of full row rank and Z N = 0; None if N is not finite."""
    k = len(N)
    if not np.all(np.isfinite(N)):
        return None
    a = np.abs(N).max(axis=1, initial=0.0)
    a = 1.0 / np.where(a > 0.0, a, 1.0)
    b = (np.abs(N) * a[:, None]).max(axis=0, initial=0.0)
    b = 1.0 / np.where(b > 0.0, b, 1.0)
    U, s, _ = np.linalg.svd(a[:, None] * N * b) if k else (np.zeros((0, 0)), np.zeros(0), None)
    rank = int(np.count_nonzero(s > RANK * s[0])) if k and s[0] > 0.0 else 0
    return U[:, :rank].T * a, U[:, rank:].T * a


def _assemble_mode(p, on, N, K, S, constraint, constraint_s):
    """Solve N lam = -(K x + S s) for lam and assemble the flow, with N regular."""
    n = p.A.shape[0]
    m = p.B.shape[1]
    order = S.shape[1] - 1
    a, b = _equilibrate(N)
    solve = lambda v: (
        b[:, None] * np.linalg.solve(a[:, None] * N * b, a[:, None] * v)
        if len(on)
        else np.zeros((0, v.shape[1]))
    )
    F = -solve(K)
    Phi = -solve(S.reshape(len(on), (order + 1) * (n + m))).reshape(len(on), order + 1, n + m)
    G = p.A + p.B[:, on] @ F
    U = np.einsum("ij,jkl->kil", p.B[:, on], Phi)
    U[0, :, :n] += np.eye(n)
    J = [j for j in range(m) if j not in on]
    signs = np.zeros((m, n))
    signs_s = np.zeros((m, order + 1, n + m))
    signs[on] = F
    signs_s[on] = Phi
    signs[J] = p.C[J] + p.D[np.ix_(J, on)] @ F
    signs_s[J] = np.einsum("ij,jkl->ikl", p.D[np.ix_(J, on)], Phi)
    signs_s[J, 0, n + np.array(J, int)] += 1.0
    pad = [
        np.concatenate((h, np.zeros((len(h), order + 1 - h.shape[1], n + m))), axis=1)
        for h in constraint_s
    ]
    return LcsMode(
        tuple(on),
        F,
        Phi,
        G,
        U,
        np.vstack(constraint) if constraint else np.zeros((0, n)),
        np.concatenate(pad) if pad else np.zeros((0, order + 1, n + m)),
        signs,
        signs_s,
        order,
    )


def _equilibrate(N):
    """Return row and column scales of N."""
    from nsbench.lcp.lemke import scales

    return scales(np.ascontiguousarray(N)) if len(N) else (np.ones(0), np.ones(0))
