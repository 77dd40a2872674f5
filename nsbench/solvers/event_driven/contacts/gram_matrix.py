"""Represent the Gram matrix M = G G^T of closed contacts, dense or by its sparse rows.

Both forms solve the velocity LCP  0 <= lam _|_ w = h + M lam >= 0  with lam > 0 on independent rows
only: small problems by principal pivoting (lcp.gram_lcp), large ones by the active-set method of
qp.kernels, whose factors are sparse. What that does not solve to rounding is solved densely.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Above so many rows dense factors take longer than sparse ones with their ordering.
MAX_DENSE_ROWS = 120
MAX_SPARSE_RESIDUAL = 1e-10  # relative to the drift: of a solution by sparse factors


@dataclass(frozen=True, eq=False)
class Dense:
    """Gram matrix M (m, m) as an array; norm (m,): lengths of the rows."""

    M: np.ndarray
    norm: np.ndarray

    def solve(
        self, h: np.ndarray, warm: np.ndarray, tol: np.ndarray, dependent: float, size: float
    ) -> tuple:
        """Solve the LCP with right-hand side h (m,), starting from the rows `warm`.

        tol (m,): violation of w that counts as rounding. dependent: squared sine of dependent rows.
        size: of the drift. Returns (lam, w, support, code, row that cannot be satisfied or -1,
        iterations), see gram_lcp.solve_lcp.
        """
        from nsbench.lcp.gram_lcp import solve_lcp

        return solve_lcp(self.M, h, warm, tol, dependent)

    def hold(self, h: np.ndarray) -> np.ndarray:
        """Solve w = 0 in all rows, which are independent, for lam (m,)."""
        from nsbench.solvers.event_driven.contacts.kernels.constraint_rows import gram_solve

        return gram_solve(self.M.copy(), -h)

    def span(self, support: np.ndarray, dependent: float) -> np.ndarray:
        """Find the rows in the span of the independent rows `support`; mask (m,)."""
        from nsbench.lcp.gram_lcp import in_span

        return in_span(self.M, support, dependent) if support.size else np.zeros(len(self.M), bool)


@dataclass(frozen=True, eq=False)
class Sparse:
    """Gram matrix by its rows.

    rows: columns, values and counts of the short rows. P: their pattern for qp.kernels. vals: their
    entries in its order. norm (m,): lengths of the rows.
    """

    rows: tuple
    n: int
    P: tuple
    vals: np.ndarray
    norm: np.ndarray

    def solve(
        self, h: np.ndarray, warm: np.ndarray, tol: np.ndarray, dependent: float, size: float
    ) -> tuple:
        """Solve the LCP as Dense.solve does."""
        from nsbench.qp.kernels import active_set

        guess = np.zeros(len(h))
        guess[warm] = size
        lam, d, code, its = active_set.solve(self.P, self.vals, h, guess, size)
        if (
            code == active_set.SOLVED
            and active_set.residual(self.P, self.vals, h, lam, d) <= MAX_SPARSE_RESIDUAL * size
        ):
            w = np.empty(len(h))
            active_set.slack(self.P, self.vals, h, d, w)
            return lam, w, np.flatnonzero(lam > 0.0), 0, -1, its
        return self.dense().solve(h, warm, tol, dependent, size)

    def hold(self, h: np.ndarray) -> np.ndarray:
        """Solve w = 0 in all rows, as Dense.hold does."""
        from nsbench.qp.kernels.row_span import hold

        return hold(self.P, self.vals, h, self.n)

    def span(self, support: np.ndarray, dependent: float) -> np.ndarray:
        """Find the rows in the span of others, as Dense.span does."""
        from nsbench.qp.kernels.row_span import in_span

        return in_span(self.P, self.vals, support, dependent)

    def dense(self) -> Dense:
        """Return the same matrix as an array."""
        from nsbench.solvers.event_driven.contacts.kernels.constraint_rows import gram

        return Dense(gram(*self.rows, self.n), self.norm)


def gram_of(
    C: np.ndarray, V: np.ndarray, count: np.ndarray, n: int, patterns: dict
) -> Dense | Sparse:
    """Return the Gram matrix of the short rows (C, V, count) in n coordinates.

    patterns: holds the last sparse pattern, which is used again for the same columns.
    """
    from nsbench.solvers.event_driven.contacts.kernels.constraint_rows import gram

    if len(count) <= MAX_DENSE_ROWS:
        M = gram(C, V, count, n)
        return Dense(M, np.sqrt(np.diag(M)))
    from nsbench.qp.kernels import active_set

    there = np.arange(C.shape[1]) < count[:, None]
    ptr = np.append(0, np.cumsum(count))
    cols = C[there]
    key = cols.tobytes()
    if key not in patterns:
        patterns.clear()
        patterns[key] = active_set.pattern(ptr, cols, n)
    return Sparse((C, V, count), n, patterns[key], V[there], np.sqrt((V * V).sum(1)))


def compile_sparse() -> None:
    """Load or compile what Sparse calls, on two rows."""
    from nsbench.qp.kernels import active_set

    two = np.arange(2)
    P = active_set.pattern(np.arange(3), two, 2)
    h = np.array([-1.0, 1.0])
    rows = Sparse(
        (two[:, None], np.ones((2, 1)), np.ones(2, np.int64)), 2, P, np.ones(2), np.ones(2)
    )
    rows.solve(h, two[:1], 0.0, 1e-10, 1.0)
    rows.hold(h)
    rows.span(two[:1], 1e-10)
