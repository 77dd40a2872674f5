"""The linearised sweep of projections over closed contacts.

With the Gram matrix A of the unit normals, gaps g (in units of the length of their gradients) and
an order of the contacts, each projection restores its own gap where it is violated:

    c_k = max(0, -(g_k + sum_{l before k} a_kl c_l)),      g' = g + A c.

Projections of discs onto their exact distances differ from it by O(|g|^2). v = max(-g, 0) are the
violations before, v' = max(-g', 0) those after the sweep.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class SweepResult:
    """Corrections c (m,) and gaps g' (m,) after a sweep."""

    corrections: np.ndarray
    gaps: np.ndarray

    @property
    def violations(self) -> np.ndarray:
        """Return v' = max(-g', 0), (m,)."""
        return np.maximum(-self.gaps, 0.0)


def sweep(gram: np.ndarray, order: np.ndarray, gaps: np.ndarray) -> SweepResult:
    """Apply one sweep in the given order (m,), a permutation of the contacts, to the gaps (m,)."""
    c = np.zeros(len(gram))
    for k in order:
        c[k] = max(0.0, -(gaps[k] + gram[k] @ c))
    return SweepResult(c, gaps + gram @ c)


def longest_increasing_path(gram: np.ndarray, order: np.ndarray) -> int:
    """Count the contacts on the longest path of neighbours that the order visits one by one."""
    length = np.zeros(len(gram), dtype=int)
    for k in order:
        before = length[(gram[k] != 0.0) & (length > 0)]
        length[k] = 1 + (before.max() if before.size else 0)
    return int(length.max()) if len(length) else 0
