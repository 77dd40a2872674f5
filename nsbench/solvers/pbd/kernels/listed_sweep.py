"""Gauss-Seidel sweep over a neighbour list, stopped where a projection moves a particle too far.

A particle is too far where it has moved by more than skin / 2 since the list was built: then the
list may lack a pair, and `renew` builds it anew.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from nsbench.compilation.borrowed_arrays import borrowed
from nsbench.compilation.decorators import fused_kernel, inner_kernel
from nsbench.dynamics.contacts.kernels.contact_arrays import PAIR, ROW, ListedContacts
from nsbench.solvers.pbd.kernels.neighbor_list import rebuild
from nsbench.solvers.pbd.kernels.projection import project

if TYPE_CHECKING:
    from nsbench.dynamics.contacts.kernels.contact_arrays import AffineRows
    from nsbench.solvers.pbd.kernels.neighbor_list import HardScene


class NeighborList(NamedTuple):
    """A list in use: its contacts, keys and impulses (m,), and counters.

    rebuilds: lists built so far; peak: entries of the longest one.
    """

    contacts: ListedContacts
    keys: np.ndarray
    mu: np.ndarray
    rebuilds: int
    peak: int


@fused_kernel
def is_beyond(x: np.ndarray, base: np.ndarray, first: int, dim: int, limit2: float) -> bool:
    """Return whether the particle at coordinate `first` is farther than sqrt(limit2) from base."""
    s = 0.0
    for c in range(first, first + dim):
        e = x[c] - base[c]
        s += e * e
    return s > limit2


@inner_kernel
def sweep_on(
    c: int,
    contacts: ListedContacts,
    mu: np.ndarray,
    rows: AffineRows,
    b: np.ndarray,
    anchors: np.ndarray,
    x: np.ndarray,
    base: np.ndarray,
    owner: np.ndarray,
    limit2: float,
) -> tuple[int, int, bool, bool]:
    """Project on the constraints from c on, to the end or until a particle has moved too far.

    contacts: ListedContacts; mu (m,): their impulses, which grow; owner: see HardScene. Returns the
    next constraint, the projections done, whether centres coincided, and whether a particle is
    farther than sqrt(limit2) from base.
    """
    contacts = borrowed(contacts)
    rows = borrowed(rows)
    work = 0
    tied = False
    _, _, _, _, p, q, d, sign, dim = contacts
    kind = contacts.kind
    while c < kind.size:
        m = project(kind[c], p[c], q[c], d[c], sign[c], dim[c], x, rows, b, anchors)
        c += 1
        if m == 0.0:
            continue
        work += 1
        tied = tied or m < 0.0
        mu[c - 1] += abs(m)
        if has_left(kind[c - 1], p[c - 1], q[c - 1], rows, x, base, owner, limit2):
            return c, work, tied, True
    return c, work, tied, False


@fused_kernel
def has_left(
    kind: int,
    p: int,
    q: int,
    rows: AffineRows,
    x: np.ndarray,
    base: np.ndarray,
    owner: np.ndarray,
    limit2: float,
) -> bool:
    """Return whether a hard particle of the constraint, given as Contacts hold it, is farther than
    sqrt(limit2) from base."""
    if kind == ROW:
        for e in range(rows.ptr[p], rows.ptr[p + 1]):
            i = rows.cols[e]
            if owner[i, 0] >= 0 and is_beyond(x, base, owner[i, 0], owner[i, 1], limit2):
                return True
        return False
    if owner[p, 0] >= 0 and is_beyond(x, base, owner[p, 0], owner[p, 1], limit2):
        return True
    if kind == PAIR:
        return owner[q, 0] >= 0 and is_beyond(x, base, owner[q, 0], owner[q, 1], limit2)
    return False


@inner_kernel
def any_beyond(x: np.ndarray, base: np.ndarray, hard: np.ndarray, limit2: float) -> bool:
    """Return whether any hard particle is farther than sqrt(limit2) from base."""
    for u in range(hard.shape[0]):
        _, start, n, dim = hard[u]
        for i in range(n):
            if is_beyond(x, base, start + i * dim, dim, limit2):
                return True
    return False


@inner_kernel
def renew(
    near: NeighborList,
    x: np.ndarray,
    base: np.ndarray,
    skin: float,
    scene: HardScene,
    keys: np.ndarray,
) -> NeighborList:
    """Build the list anew at x, with that skin; base becomes x. Returns the NeighborList."""
    contacts, new_keys, mu = rebuild(near.contacts, near.keys, near.mu, x, skin, scene, keys)
    for e in range(x.size):
        base[e] = x[e]
    return NeighborList(contacts, new_keys, mu, near.rebuilds + 1, max(near.peak, new_keys.size))


@inner_kernel
def first_after(keys: np.ndarray, last: int) -> int:
    """Return the first place whose key is larger than `last`."""
    c = 0
    while c < keys.size and keys[c] <= last:
        c += 1
    return c
