"""The Gram matrix M = G G^T of a list of closed contacts, dense or by its sparse rows: velocity
problems and spans.

Both solve  0 <= lam _|_ w = h + M lam >= 0  with lam > 0 on independent rows alone: small lists by
kernels.lcp, long ones by the active set of kernels.qp, whose factors are sparse. What that does not
solve to rounding is solved densely.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# rows: dense factors of as many take longer than sparse ones with their search for an order
LONG = 120
SOLVED = 1e-10  # of the size of speeds: the residual of a solution by sparse factors


@dataclass(frozen=True, eq=False)
class Dense:
    """norm (m,): lengths of the rows."""

    M: np.ndarray
    norm: np.ndarray

    def solve(self, h, warm, tol, dependent, size):
        """lam, w, support, code, row that cannot be satisfied or -1, iterations (see
        lcp.solve_lcp)."""
        from nsbench.lcp.gram_lcp import solve_lcp

        return solve_lcp(self.M, h, warm, tol, dependent)

    def hold(self, h) -> np.ndarray:
        """(m,) lam with w = 0 in all rows, which are independent."""
        from nsbench.solvers.event_driven.contacts.kernels.constraint_rows import gram_solve

        return gram_solve(self.M.copy(), -h)

    def span(self, support, dependent) -> np.ndarray:
        """(m,) which rows lie in the span of the independent rows `support`."""
        from nsbench.lcp.gram_lcp import in_span

        return in_span(self.M, support, dependent) if support.size else np.zeros(len(self.M), bool)


@dataclass(frozen=True, eq=False)
class Sparse:
    """rows: columns, values, lengths; P: their pattern for kernels.qp; vals: their entries in its
    order."""

    rows: tuple
    n: int
    P: tuple
    vals: np.ndarray
    norm: np.ndarray

    def solve(self, h, warm, tol, dependent, size):
        """As Dense.solve."""
        from nsbench.qp.kernels import active_set

        guess = np.zeros(len(h))
        guess[warm] = size
        lam, d, code, its = active_set.solve(self.P, self.vals, h, guess, size)
        if (
            code == active_set.SOLVED
            and active_set.residual(self.P, self.vals, h, lam, d) <= SOLVED * size
        ):
            w = np.empty(len(h))
            active_set.slack(self.P, self.vals, h, d, w)
            return lam, w, np.flatnonzero(lam > 0.0), 0, -1, its
        return self.dense().solve(h, warm, tol, dependent, size)

    def hold(self, h) -> np.ndarray:
        from nsbench.qp.kernels.row_span import hold

        return hold(self.P, self.vals, h, self.n)

    def span(self, support, dependent) -> np.ndarray:
        from nsbench.qp.kernels.row_span import in_span

        return in_span(self.P, self.vals, support, dependent)

    def dense(self) -> Dense:
        from nsbench.solvers.event_driven.contacts.kernels.constraint_rows import gram

        return Dense(gram(*self.rows, self.n), self.norm)


def gram_of(C, V, count, n, patterns: dict):
    """The matrix of the rows (C, V, count) in n coordinates. patterns: the last sparse pattern, to
    be used again."""
    from nsbench.solvers.event_driven.contacts.kernels.constraint_rows import gram

    if len(count) <= LONG:
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


def compile_sparse():
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
