"""Unit gradients of contacts by their entries: products, Gram systems, projection on their cone."""

from __future__ import annotations

import numpy as np


def for_kernel(a: np.ndarray) -> np.ndarray:
    """Return the array in the layout for which kernels are compiled.

    numba compiles a function anew for arrays that may not be written to.
    """
    return a if a.flags.c_contiguous and a.flags.writeable else np.array(a, float, order="C")


class UnitGradients:
    """Unit gradients N (K, m, n) of m contacts at K states, by their entries.

    columns (m, w), count (m,): coordinates of the entries, which are the same at all states; values
    (K, m, w), or (1, m, w) where gradients do not depend on the state. n: coordinates. Vectors d
    (K, n), multipliers q and rates g (K, m).
    """

    __slots__ = ("columns", "count", "n", "values")

    def __init__(self, columns: np.ndarray, count: np.ndarray, values: np.ndarray, n: int):
        self.columns = columns
        self.count = count
        self.values = values
        self.n = n

    @classmethod
    def of(cls, N: np.ndarray) -> UnitGradients:
        """Return dense unit gradients (K, m, n) as such."""
        _, m, n = N.shape
        columns = np.tile(np.arange(n), (m, 1))
        return cls(columns, np.full(m, n), for_kernel(N), n)

    def dense(self) -> np.ndarray:
        """Return (K, m, n) the gradients as dense matrices."""
        N = np.zeros((*self.values.shape[:2], self.n))
        for k, c in enumerate(self.count):
            for e in range(c):  # a column may be listed twice
                N[:, k, self.columns[k, e]] += self.values[:, k, e]
        return N

    def times(self, d: np.ndarray) -> np.ndarray:
        """Return (K, m) the products N d."""
        from nsbench.error_bars.kernels.gram import times

        out = np.empty((len(d), len(self.columns)))
        times(self.columns, self.values, self.count, for_kernel(d), out)
        return out

    def back(self, q: np.ndarray) -> np.ndarray:
        """Return (K, n) the products N^T q."""
        from nsbench.error_bars.kernels.gram import add_back

        out = np.zeros((len(q), self.n))
        add_back(self.columns, self.values, self.count, for_kernel(q), out)
        return out

    def normal_part(self, g: np.ndarray, is_refined: bool = True) -> np.ndarray:
        """Return (K, n) the shortest d with N d = g.

        Rows that depend on one another are damped (kernels.gram); one step of iterative refinement,
        which an iteration over N does without.
        """
        if not g.any():
            return np.zeros((len(g), self.n))
        return self.back(self.multipliers(g, is_refined))

    def multipliers(self, g: np.ndarray, is_refined: bool = False) -> np.ndarray:
        """Return (K, m) q with N N^T q = g, by Gram matrices that are damped.

        is_refined: with a step of iterative refinement against the matrices without damping.
        """
        from nsbench.error_bars.kernels.gram import gram_multipliers

        q = np.empty(g.shape)
        arrays = self.columns, self.values, self.count
        gram_multipliers(*arrays, self.n, for_kernel(g), is_refined, q)
        return q

    def off_cone(self, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Split d into N^T q with q >= 0 and a shortest rest; return rest (K, n) and q (K, m).

        The rest is what an inclusion x' in f + N^T q lacks.
        """
        from nsbench.error_bars.kernels.cone_projection import split_off_cone

        q = np.empty((len(d), len(self.columns)))
        rest = np.empty(d.shape)
        split_off_cone(self.columns, self.values, self.count, for_kernel(d), q, rest)
        return rest, q
