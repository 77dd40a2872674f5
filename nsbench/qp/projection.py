"""Projection QP from Python: its rows, its answer, and the active-set solver of this package.

min 1/2 |d|^2  s.t.  q + G d >= 0        d = G^T mu,    0 <= mu  _|_  q + G d >= 0
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from scipy.sparse import csc_matrix, sparray

DENSE = 10_000  # entries of G: below, SciPy solves before a kernel is compiled
CODES = ("solved", "infeasible", "maxiter")  # by the codes of qp.kernels.dual_active_set


@dataclass(frozen=True)
class Answer:
    """Solution of a projection QP: mu (m,), d (n,) as the solver returned them, code ("solved",
    "infeasible", "maxiter") and its iterations."""

    mu: np.ndarray
    d: np.ndarray
    code: str
    iterations: int


class SparseRows:
    """Rows of G (m, n) by entries: row (e,), cols (e,) and vals (e,), rows in order, columns in
    order in every row, ptr (m + 1,).

    A product costs two numpy calls: a csr_array checks itself at every operation, for longer than a
    small QP takes.
    """

    def __init__(self, row: np.ndarray, cols: np.ndarray, shape: tuple[int, int]):
        self.order = np.lexsort((cols, row))
        self.row = row[self.order]
        self.cols = cols[self.order]
        self.shape = shape
        self.ptr = np.concatenate(([0], np.cumsum(np.bincount(row, minlength=shape[0])))).astype(
            np.int64
        )
        self.down = np.lexsort((self.row, self.cols))  # entries by columns
        self.down_ptr = np.concatenate(
            ([0], np.cumsum(np.bincount(cols, minlength=shape[1])))
        ).astype(np.int64)
        self.vals = np.empty(row.size)

    @classmethod
    def of(cls, G: sparray) -> SparseRows:
        """Return the rows of a scipy sparse array without duplicates."""
        G = G.tocoo()
        return cls(G.row.astype(np.int64), G.col.astype(np.int64), G.shape).fill(G.data)

    def fill(self, values: np.ndarray) -> SparseRows:
        """Set the entries to values (e,), in the order in which their places were given; returns
        self."""
        self.vals = values[self.order]
        return self

    def __matmul__(self, d: np.ndarray) -> np.ndarray:
        return np.bincount(self.row, self.vals * d[self.cols], self.shape[0])

    def back(self, mu: np.ndarray) -> np.ndarray:
        """Return G^T mu (n,)."""
        return np.bincount(self.cols, self.vals * mu[self.row], self.shape[1])

    def lengths(self) -> np.ndarray:
        """Return the length |G_k| of every row, (m,)."""
        return np.sqrt(np.bincount(self.row, self.vals * self.vals, self.shape[0]))

    def csc(self) -> csc_matrix:
        """Return G as scipy's csc_matrix, for the libraries."""
        from scipy.sparse import csc_matrix

        return csc_matrix(
            (self.vals[self.down], self.row[self.down], self.down_ptr), shape=self.shape
        )


class ActiveSet:
    """Solver of projection QPs by nsbench.qp.kernels.dispatch, as in the compiled loop; its
    iterations are factorisations."""

    def __init__(self, eps=None, max_iter=None):
        self._key = None
        self._pattern = None
        self.setups = 0
        self._tree_buffer = np.zeros(2, np.int64)
        self._work_buffer = np.empty(1)

    def __call__(
        self, G: SparseRows, q: np.ndarray, h: float, key: object, mu: np.ndarray
    ) -> Answer:
        from nsbench.qp.kernels import active_set, active_set_callback, dispatch

        if key is not self._key:
            self._key = key
            self.setups = self.setups + 1
            self._pattern = active_set.outline(G.ptr, G.cols, G.shape[1])
            self._tree_buffer[0] = 0
        scale = max(1.0, float(np.abs(q).max(initial=0.0)))
        work = np.zeros(dispatch.WORK, np.int64)
        mu, d, self._tree_buffer, self._work_buffer = dispatch.solve_projection(
            active_set_callback.solve_exact,
            large_problem_callback(G.shape[0]),
            self._pattern,
            self._tree_buffer,
            self._work_buffer,
            G.vals,
            q,
            mu,
            scale,
            work,
        )
        return Answer(mu, d, CODES[work[dispatch.CODE]], int(work[dispatch.ROUNDS]))


def large_problem_callback(rows: int) -> Callable:
    """Return the callback for large problems, compiled only where there are so many rows."""
    from nsbench.qp.kernels import dispatch

    if rows <= dispatch.SMALL_PROBLEM:
        return dispatch.no_large_solver
    from nsbench.qp.kernels import large_callback

    return large_callback.solve_large


def least_distance(
    row: np.ndarray, cols: np.ndarray, vals: np.ndarray, q: np.ndarray, n: int, guess: np.ndarray
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Return the shortest d (n,) with q + G d >= 0, and its multipliers mu (m,).

    row, cols, vals: entries of G (m, n); q (m,); guess (m,): multipliers to start from. Solved by
    non-negative least squares (Lawson & Hanson 1974, chapter 23) where G is small, else by the
    active sets of `ActiveSet`; both with rows of length one and in units of the largest violation.
    Returns (None, None) where there is no such d.
    """
    norm = np.sqrt(np.bincount(row, vals * vals, len(q)))
    norm[norm == 0.0] = 1.0
    unit = float((-q / norm).max(initial=0.0))
    if unit == 0.0:
        return np.zeros(n), np.zeros(len(q))
    d, mu = _in_units(row, cols, vals / norm[row], q / norm / unit, n, guess * norm / unit)
    return (None, None) if d is None else (unit * d, unit * mu / norm)


def _in_units(row, cols, vals, q, n, guess):
    if not len(q) * n <= DENSE:
        return _by_active_sets(row, cols, vals, q, n, guess)
    from scipy.optimize import nnls

    E = np.zeros((n + 1, len(q)))
    np.add.at(E, (cols, row), vals)
    E[n] = -q
    rhs = np.append(np.zeros(n), 1.0)
    try:
        mu, size = nnls(E, rhs)
    except RuntimeError:  # its iterations ran out
        return _by_active_sets(row, cols, vals, q, n, guess)
    r = E @ mu - rhs
    if size < 1e-12 or not r[-1] < 0.0:
        return None, None
    return -r[:-1] / r[-1], mu / -r[-1]


def _by_active_sets(row, cols, vals, q, n, guess):
    G = SparseRows(row, cols, (len(q), n)).fill(vals)
    a = ActiveSet()(G, q, 1.0, G, guess)
    return (None, None) if a.code == "infeasible" else (a.d, a.mu)
