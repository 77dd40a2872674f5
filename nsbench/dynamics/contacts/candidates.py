"""Candidate contacts as arrays: the constraints of a problem that are evaluated in one state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.dynamics.contacts.kernels.contact_arrays import (
    ANCHOR,
    PAIR,
    ROW,
    SMOOTH,
    Contacts,
    ListedContacts,
)

__all__ = [
    "ANCHOR",
    "PAIR",
    "ROW",
    "SMOOTH",
    "CandidateContacts",
    "ContactLayout",
    "Contacts",
    "ListedContacts",
    "join",
    "make_candidates",
    "pairs_brute_force",
]


@dataclass(frozen=True, eq=False)
class CandidateContacts:
    """Candidate contacts, m of them: arrays of length m.

    kind (ROW, PAIR, ANCHOR, SMOOTH); family, i, j (j = -1 where an id has no second index); p, q:
    row number or first coordinate of particle i; first coordinate of particle j or of the anchor;
    d, sign, dim of a distance.
    """

    kind: np.ndarray
    family: np.ndarray
    i: np.ndarray
    j: np.ndarray
    p: np.ndarray
    q: np.ndarray
    d: np.ndarray
    sign: np.ndarray
    dim: np.ndarray

    def __len__(self) -> int:
        return len(self.kind)

    @property
    def ids(self) -> list[tuple]:
        """Return the contact ids as tuples (family, i) or (family, i, j)."""
        return [
            (f, i) if j < 0 else (f, i, j)
            for f, i, j in zip(self.family.tolist(), self.i.tolist(), self.j.tolist(), strict=True)
        ]

    @property
    def key(self) -> np.ndarray:
        """Return (m,) one integer per id; ids have at most 2^21 members in each index."""
        return (self.family << 42) + (self.i << 21) + self.j + 1

    @property
    def contacts(self) -> Contacts:
        """Return the arrays that describe the gaps, named as kernels receive them."""
        return Contacts(self.kind, self.p, self.q, self.d, self.sign, self.dim)

    def take(self, index: np.ndarray) -> CandidateContacts:
        """Return the entries of the given index or mask."""
        return CandidateContacts(*(a[index] for a in self.arrays()))

    def copy(self) -> CandidateContacts:
        """Return a copy that shares no array."""
        return CandidateContacts(*(a.copy() for a in self.arrays()))

    def arrays(self) -> ListedContacts:
        """Return the arrays, named as kernels receive them."""
        return ListedContacts(
            self.kind, self.family, self.i, self.j, self.p, self.q, self.d, self.sign, self.dim
        )


@dataclass(frozen=True)
class ContactLayout:
    """Positions of the entries of CandidateContacts, by kind.

    pairs: (kind, entries, coordinates of i, of j or of the anchor) by kind and dimension; rows:
    entries that are affine rows; smooth: entries of each Smooth family.
    """

    pairs: tuple
    rows: np.ndarray
    smooth: tuple


def make_candidates(
    kind: int, family: int, i, j, p, q, d, sign: float, dim: int
) -> CandidateContacts:
    """Build CandidateContacts from arrays (m,) or scalars, which are broadcast."""
    m = len(i)
    i, j, p, q = (np.asarray(a, np.int64) for a in (i, j, p, q))
    return CandidateContacts(
        np.full(m, kind, np.int64),
        np.full(m, family, np.int64),
        i,
        j,
        p,
        q,
        np.broadcast_to(np.asarray(d, float), m).copy(),
        np.full(m, float(sign)),
        np.full(m, dim, np.int64),
    )


def pairs_brute_force(x: np.ndarray, r: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """List the pairs (i, j), i < j, in order, whose gap is at most `reach`, by testing all of them.

    x (m, dim), r (m,): positions and radii. For few particles; kernels.cell_list does the same for
    many.
    """
    i, j = np.triu_indices(len(x), 1)
    if reach == np.inf:
        return i, j
    s = np.zeros(len(i))
    for c in range(x.shape[1]):
        s += (x[i, c] - x[j, c]) ** 2
    close = s <= (r[i] + r[j] + reach) ** 2
    return i[close], j[close]


def join(parts: list[CandidateContacts]) -> CandidateContacts:
    """Concatenate candidate contacts in the given order."""
    if not parts:
        return make_candidates(ROW, 0, [], [], [], [], 0.0, 1, 1)
    return CandidateContacts(
        *(np.concatenate(a) for a in zip(*(n.arrays() for n in parts), strict=True))
    )
