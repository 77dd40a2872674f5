"""Three ways to solve the least-distance problem of one step, behind one call, and the residual that judges them.

    min 1/2 |d|^2  s.t.  q + G d >= 0        d = G^T mu,    0 <= mu  _|_  q + G d >= 0

A backend is made once per run and called as ``backend(G, q, h, key, mu)``: G (m, n) csr_array, q (m,), h the step,
key an object that stays the same as long as the constraints do, mu (m,) a first guess. It returns an Answer. The libraries
solve in units of velocity, (d / h, mu / h, q / h), so that their tolerances mean the same for every step.
"""
from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Answer:
    """mu (m,), d (n,) as the solver gave them, code ("solved", "infeasible", "maxiter") and its iterations."""
    mu: np.ndarray
    d: np.ndarray
    code: str
    iterations: int


def residual(G, w: np.ndarray, mu: np.ndarray, d: np.ndarray) -> float:
    """How far (d, mu) is from solving the problem, as a length: the largest of

        stationarity     |d - G^T mu|
        primal           -w_k / |G_k|                       w = q + G d
        sign             -mu_k |G_k|
        complementarity  min(mu_k |G_k|, w_k / |G_k|)

    the last three being |min(mu_k |G_k|, w_k / |G_k|)|. Not computed from anything the solver says about itself.
    """
    norm = np.sqrt((G * G).sum(axis=1))
    stationarity = np.abs(d - G.T @ mu).max(initial=0.0)
    return float(np.maximum(stationarity, np.abs(np.minimum(mu * norm, w / norm)).max(initial=0.0)))


class ActiveSet:
    """nsbench.kernels.least, as in the compiled loop; rounds of factorisation are its iterations."""

    def __init__(self, eps=None, max_iter=None):
        self._key, self._pattern, self.setups = None, None, 0
        self._book, self._store = np.zeros(2, np.int64), np.empty(1)

    def __call__(self, G, q, h, key, mu):
        from nsbench.kernels import few, least, qp
        if key is not self._key:
            self._key, self.setups = key, self.setups + 1
            self._pattern = qp.pattern(G.indptr.astype(np.int64), G.indices.astype(np.int64), G.shape[1])
            self._book[0] = 0
        scale, work = max(1.0, float(np.abs(q).max(initial=0.0))), np.zeros(4, np.int64)
        mu, d, self._book, self._store = least.least(few.exact, many_rows(G.shape[0]), self._pattern, self._book, self._store,
                                                     G.data, q, mu, scale, work)
        return Answer(mu, d, ("solved", "infeasible", "maxiter")[work[0]], int(work[1]))


def many_rows(rows):
    """The projector for many rows, compiled where there are many."""
    from nsbench.kernels import least
    if rows <= least.FEW:
        return least.nobody
    from nsbench.kernels import many
    return many.many


class OSQP:
    """OSQP (Stellato et al. 2020): set up once for a list of constraints, then updated; polished; warm-started.

    Its dual of a lower bound is negative: mu = -h y.
    """

    def __init__(self, eps=None, max_iter=None):
        self._settings = {"eps_abs": eps or 1e-8, "eps_rel": eps or 1e-8, "max_iter": max_iter or 20000,
                          "eps_prim_inf": 1e-10, "polishing": True, "verbose": False, "warm_starting": True}
        self._key, self._solver, self.setups = None, None, 0

    def __call__(self, G, q, h, key, mu):
        import osqp
        m, n = G.shape
        A = G.tocsc()
        low = -q / h
        if key is not self._key:
            from scipy.sparse import csc_matrix
            self._key, self.setups, self._solver = key, self.setups + 1, osqp.OSQP()
            self._solver.setup(csc_matrix(np.eye(1)) if n == 1 else _identity(n), np.zeros(n), csc_matrix(A), low,
                               np.full(m, np.inf), **self._settings)
            self._solver.warm_start(x=G.T @ mu / h, y=-mu / h)
        else:
            self._solver.update(Ax=A.data, l=low)
        r = self._solver.solve(raise_error=False)
        status = osqp.SolverStatus(r.info.status_val)
        code = {osqp.SolverStatus.OSQP_SOLVED: "solved", osqp.SolverStatus.OSQP_PRIMAL_INFEASIBLE: "infeasible"}
        return Answer(-h * r.y, h * r.x, code.get(status, "maxiter"), int(r.info.iter))


class PIQP:
    """PIQP (Schwan et al. 2023), an interior point method: set up once for a list of constraints, then updated."""

    def __init__(self, eps=None, max_iter=None):
        self._eps, self._max_iter = eps or 1e-11, max_iter or 250
        self._key, self._solver, self.setups = None, None, 0

    def __call__(self, G, q, h, key, mu):
        import piqp
        from scipy.sparse import csc_matrix
        A, n = csc_matrix(G.tocsc()), G.shape[1]
        if key is not self._key:
            self._key, self.setups, self._solver = key, self.setups + 1, piqp.SparseSolver()
            s = self._solver.settings
            s.eps_abs, s.eps_rel, s.max_iter, s.verbose = self._eps, self._eps, self._max_iter, False
            s.eps_duality_gap_abs, s.eps_duality_gap_rel = self._eps, self._eps
            self._solver.setup(P=_identity(n), c=np.zeros(n), G=A, h_l=-q / h)
        else:
            self._solver.update(G=A, h_l=-q / h)
        status = self._solver.solve()
        r = self._solver.result
        code = {piqp.PIQP_SOLVED: "solved", piqp.PIQP_PRIMAL_INFEASIBLE: "infeasible"}.get(status, "maxiter")
        return Answer(h * np.array(r.z_l), h * np.array(r.x), code, int(r.info.iter))


def _identity(n):
    from scipy.sparse import csc_matrix, identity
    return csc_matrix(identity(n, format="csc"))


BACKENDS = {"active_set": ActiveSet, "osqp": OSQP, "piqp": PIQP}
