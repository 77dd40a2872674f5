"""Subspaces of errors: tangential to the contacts that act, and the spans of groups of these.

See nsbench.error_bars.split_bound.
"""

from __future__ import annotations

import numpy as np

from nsbench.error_bars.growth import Linear
from nsbench.error_bars.kernels.split_step import SplitArrays
from nsbench.error_bars.unit_gradients import for_kernel

RANK = 1e-9  # relative singular value below which rows count as dependent


class Part:
    """A subspace of errors: projection (n, n), and how the drift acts on it.

    rate: one-sided Lipschitz constant in it. inflow: norm of the drift's derivative into it from
    the rest. N (m, n): unit gradients of the group whose span it is, (0, n) of the tangential part.
    """

    def __init__(self, basis: np.ndarray, N: np.ndarray, drift: Linear):
        n = len(drift.J)
        self.projection = basis @ basis.T
        rest = np.eye(n) - self.projection
        self.is_empty = basis.shape[1] == 0
        self.rate = _largest(basis.T @ (0.5 * (drift.J + drift.J.T)) @ basis) + drift.change
        self.inflow = _norm(self.projection @ drift.J @ rest)
        self.is_independent = 0 < len(N) == basis.shape[1]
        self.reach = np.linalg.norm(np.linalg.pinv(N, rcond=RANK), axis=0) if len(N) else None


class Split:
    """Subspaces of the errors: tangential to the contacts, and the spans of their groups. Raises
    ArithmeticError for a drift whose derivative is not finite.

    contacts: places of the contacts among all constraints; every (m, n): unit gradients of these.
    groups: by part the positions of its contacts among `contacts`, of the tangential part, the
    first one, none.
    """

    def __init__(self, contacts: tuple, every: np.ndarray, drift: Linear):
        if not np.all(np.isfinite(drift.J)):
            raise ArithmeticError("the derivative of the drift is not finite")
        N = every[list(contacts)]
        self.contacts = contacts
        self.drift = drift
        self.groups = [np.empty(0, int), *_coupled(N)]
        n = len(drift.J)
        bases = [_span(N[g]) for g in self.groups[1:]]
        whole = np.hstack([np.zeros((n, 0)), *bases])
        tangent = np.linalg.svd(whole)[0][:, whole.shape[1] :] if whole.size else np.eye(n)
        self.parts = [
            Part(basis, N[g], drift)
            for basis, g in zip([tangent, *bases], self.groups, strict=True)
        ]
        self.tangent = self.parts[0].projection
        self.along = self.tangent @ drift.J @ self.tangent
        self.speed = float(np.linalg.norm(self.along))
        self._norms_in: dict[tuple, np.ndarray] = {}
        self.arrays = self._arrays(every, bases)

    def _arrays(self, every, bases) -> SplitArrays:
        """Return what the kernel knows of the split."""
        n = every.shape[1]
        drift = self.drift
        of_parts = [(p.is_empty, p.rate, p.inflow) for p in self.parts]
        is_empty, rates, inflows = (np.array(v) for v in zip(*of_parts, strict=True))
        is_in = np.zeros(len(every), bool)
        is_in[list(self.contacts)] = True
        sizes = [np.linalg.norm(every @ p.projection, axis=1) for p in self.parts]
        return SplitArrays(
            B=for_kernel(np.hstack([np.zeros((n, 0)), *bases]).T),
            ptr=np.cumsum([0, *(b.shape[1] for b in bases)]),
            is_empty=is_empty,
            along=for_kernel(self.along),
            speed=self.speed,
            rates=rates,
            inflows=inflows,
            J=for_kernel(drift.J),
            change=float(drift.change),
            one_sided=float(drift.one_sided),
            two_sided=float(drift.two_sided),
            is_in=is_in,
            sizes=np.array(sizes),
        )

    def norms_in(self, other: Split) -> np.ndarray:
        """Return the norms of the products of projections on the parts of another split (rows) and
        on those of this one (columns)."""
        if other.contacts not in self._norms_in:
            rows = [[_norm(p.projection @ q.projection) for q in self.parts] for p in other.parts]
            self._norms_in[other.contacts] = np.array(rows)
        return self._norms_in[other.contacts]


def _coupled(N: np.ndarray) -> list[np.ndarray]:
    """Return groups of rows (m, n) such that rows of different groups are orthogonal."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    if not len(N):
        return []
    count, label = connected_components(csr_array(np.abs(N @ N.T) > RANK))
    return [np.flatnonzero(label == g) for g in range(count)]


def _span(N: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis (n, rank) of the span of rows N (m, n)."""
    _, s, V = np.linalg.svd(N, full_matrices=False)
    return V[s > RANK * s[0]].T


def _largest(A: np.ndarray) -> float:
    return float(np.linalg.eigvalsh(A)[-1]) if A.size else 0.0


def _norm(A: np.ndarray) -> float:
    return float(np.linalg.norm(A, 2)) if A.size else 0.0
