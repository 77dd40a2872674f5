"""Backends for the least-distance problem of one step, and the KKT residual of their answers.

    min 1/2 |d|^2  s.t.  q + G d >= 0        d = G^T mu,    0 <= mu  _|_  q + G d >= 0

A backend is built once per run and called as ``backend(G, q, h, key, mu)``: G (m, n) SparseRows, q
(m,), h the step, key an object that stays the same as long as the constraints do, mu (m,) a first
guess. It returns an Answer. The libraries solve in units of velocity, (d / h, mu / h, q / h), so
that their tolerances mean the same for every step; these are absolute, so where all speeds are
below 1 they are in units of the largest that is required, to a power of two (see `unit`).
"""

from __future__ import annotations

import numpy as np

from nsbench.qp.projection import ActiveSet, Answer, SparseRows


def residual(G: SparseRows, w: np.ndarray, mu: np.ndarray, d: np.ndarray) -> float:
    """Return the KKT residual of (d, mu), a length: the largest violation of four conditions.

        stationarity     |d - G^T mu|
        primal           -w_k / |G_k|                       w = q + G d
        sign             -mu_k |G_k|
        complementarity  min(mu_k |G_k|, w_k / |G_k|)

    The last three are |min(mu_k |G_k|, w_k / |G_k|)|. G: SparseRows or a scipy sparse array. It
    does not depend on anything the solver reports about itself.
    """
    G = G if isinstance(G, SparseRows) else SparseRows.of(G)
    norm = G.lengths()
    stationarity = np.abs(d - G.back(mu)).max(initial=0.0)
    return float(np.maximum(stationarity, np.abs(np.minimum(mu * norm, w / norm)).max(initial=0.0)))


LARGEST_BOUND = 1e6  # bound of a constraint over the largest speed that is asked for


def unit(G: SparseRows, q: np.ndarray, h: float) -> float:
    """Return the length that lengths are divided by: h, or less if all required speeds are small.

    It is not so small that bounds of far constraints exceed LARGEST_BOUND, where the libraries lose
    the digits of near ones.
    """
    speeds = -q / (h * G.lengths())
    asked = max(
        float(speeds.max(initial=0.0)), float(np.abs(speeds).max(initial=0.0)) / LARGEST_BOUND
    )
    return h * min(1.0, 2.0 ** np.ceil(np.log2(asked))) if 0.0 < asked < np.inf else h


INFINITE = 1e30  # to OSQP


class OSQP:
    """OSQP backend (Stellato et al. 2020), polished and warm-started.

    Set up once for a list of constraints, then updated. Its dual of a lower bound is negative: mu =
    -h y.
    """

    def __init__(self, eps: float | None = None, max_iter: int | None = None):
        self._settings = {
            "eps_abs": eps or 1e-8,
            "eps_rel": eps or 1e-8,
            "max_iter": max_iter or 20000,
            "eps_prim_inf": 1e-10,
            "polishing": True,
            "verbose": False,
            "warm_starting": True,
        }
        self._key = None
        self._solver = None
        self.setups = 0

    def __call__(
        self, G: SparseRows, q: np.ndarray, h: float, key: object, mu: np.ndarray
    ) -> Answer:
        """Solve the problem; return an Answer.

        Its status is "maxiter" where a bound exceeds INFINITE.
        """
        import osqp

        m, n = G.shape
        h = unit(G, q, h)
        low = -q / h
        if (
            not np.abs(low).max(initial=0.0) < INFINITE
        ):  # it would print an error and solve with the bounds of before
            return Answer(np.zeros(m), np.zeros(n), "maxiter", 0)
        if key is not self._key:
            from scipy.sparse import csc_matrix

            self._key, self.setups, self._solver = key, self.setups + 1, osqp.OSQP()
            self._solver.setup(
                csc_matrix(np.eye(1)) if n == 1 else _identity(n),
                np.zeros(n),
                G.csc(),
                low,
                np.full(m, np.inf),
                **self._settings,
            )
            self._solver.warm_start(x=G.back(mu) / h, y=-mu / h)
        else:
            self._solver.update(Ax=G.vals[G.down], l=low)
        r = self._solver.solve(raise_error=False)
        status = osqp.SolverStatus(r.info.status_val)
        code = {
            osqp.SolverStatus.OSQP_SOLVED: "solved",
            osqp.SolverStatus.OSQP_PRIMAL_INFEASIBLE: "infeasible",
        }
        return Answer(-h * r.y, h * r.x, code.get(status, "maxiter"), int(r.info.iter))


class PIQP:
    """PIQP backend, an interior point method (Schwan et al. 2023).

    Set up once for a list of constraints, then updated.
    """

    def __init__(self, eps: float | None = None, max_iter: int | None = None):
        self._eps = eps or 1e-11
        self._max_iter = max_iter or 250
        self._key = None
        self._solver = None
        self._A = None
        self.setups = 0

    def __call__(
        self, G: SparseRows, q: np.ndarray, h: float, key: object, mu: np.ndarray
    ) -> Answer:
        """Solve the problem; return an Answer."""
        import piqp

        n = G.shape[1]
        h = unit(G, q, h)
        if key is not self._key:
            self._key, self.setups, self._solver = key, self.setups + 1, piqp.SparseSolver()
            s = self._solver.settings
            s.eps_abs = self._eps
            s.eps_rel = self._eps
            s.max_iter = self._max_iter
            s.verbose = False
            s.eps_duality_gap_abs = self._eps
            s.eps_duality_gap_rel = self._eps
            self._A = G.csc()
            self._solver.setup(P=_identity(n), c=np.zeros(n), G=self._A, h_l=-q / h)
        else:
            self._A.data[:] = G.vals[G.down]
            self._solver.update(G=self._A, h_l=-q / h)
        status = self._solver.solve()
        r = self._solver.result
        code = {piqp.PIQP_SOLVED: "solved", piqp.PIQP_PRIMAL_INFEASIBLE: "infeasible"}.get(
            status, "maxiter"
        )
        return Answer(h * np.array(r.z_l), h * np.array(r.x), code, int(r.info.iter))


def _identity(n):
    """Return the identity matrix (n, n) in compressed columns."""
    from scipy.sparse import csc_matrix, identity

    return csc_matrix(identity(n, format="csc"))


BACKENDS = {"active_set": ActiveSet, "osqp": OSQP, "piqp": PIQP}
