"""Candidates of a catching-up step: listed constraints and near pairs, with their gradient pattern.

Written in plain loops: numba spends seconds on every slice that is assigned to another and on every
sort.
"""

from typing import NamedTuple

import numpy as np

from nsbench.compilation.decorators import inner_kernel
from nsbench.dynamics.contacts.kernels.cell_list import near_pairs
from nsbench.dynamics.contacts.kernels.constraint_order import SORTED, sweep_key
from nsbench.dynamics.contacts.kernels.contact_arrays import PAIR, ROW, ListedContacts


class HardPairs(NamedTuple):
    """Near pairs of all hard families, one family after the other; the first `size` entries count.

    family, i, j: the id; p, q: first coordinates; dim: of a particle; d: distance of contact.
    """

    family: np.ndarray
    i: np.ndarray
    j: np.ndarray
    p: np.ndarray
    q: np.ndarray
    dim: np.ndarray
    d: np.ndarray


@inner_kernel
def _empty_pairs(size):
    """Return room for `size` pairs."""
    return HardPairs(
        np.empty(size, np.int64),
        np.empty(size, np.int64),
        np.empty(size, np.int64),
        np.empty(size, np.int64),
        np.empty(size, np.int64),
        np.empty(size, np.int64),
        np.empty(size),
    )


@inner_kernel
def _grown(pairs, m, size):
    """Return the first m pairs in arrays of the given size."""
    out = _empty_pairs(size)
    for k in range(m):
        out.family[k] = pairs.family[k]
        out.i[k] = pairs.i[k]
        out.j[k] = pairs.j[k]
        out.p[k] = pairs.p[k]
        out.q[k] = pairs.q[k]
        out.dim[k] = pairs.dim[k]
        out.d[k] = pairs.d[k]
    return out


@inner_kernel
def _hard_pairs(x, skin, hard, radii):
    """Return the HardPairs with a gap of at most skin at x, and their number."""
    # arrays grow to twice what is needed, so that few copies are made
    m = 0
    at = 0
    pairs = _empty_pairs(64)
    for u in range(hard.shape[0]):
        family, start, n, dim = hard[u]
        r = radii[at : at + n]
        at += n
        if n < 2:
            continue
        i, j = near_pairs(x, start, n, dim, r, skin)
        if m + i.size > pairs.d.size:
            pairs = _grown(pairs, m, 2 * (m + i.size))
        for k in range(i.size):
            pairs.family[m] = family
            pairs.i[m] = i[k]
            pairs.j[m] = j[k]
            pairs.p[m] = start + dim * i[k]
            pairs.q[m] = start + dim * j[k]
            pairs.dim[m] = dim
            pairs.d[m] = r[i[k]] + r[j[k]]
            m += 1
    return pairs, m


@inner_kernel
def _empty_list(size):
    """Return room for `size` contacts."""
    return ListedContacts(
        np.empty(size, np.int64),
        np.empty(size, np.int64),
        np.empty(size, np.int64),
        np.empty(size, np.int64),
        np.empty(size, np.int64),
        np.empty(size, np.int64),
        np.empty(size),
        np.empty(size),
        np.empty(size, np.int64),
    )


@inner_kernel
def gather(
    x: np.ndarray, skin: float, static: ListedContacts, hard: np.ndarray, radii: np.ndarray
) -> tuple[ListedContacts, np.ndarray]:
    """Return the candidates at x (n,) as ListedContacts, sorted, and their keys, ascending.

    static: ListedContacts of the listed constraints, by family; hard (families, 4): family, first
    coordinate, particles, dimension, by family; radii: of all hard families one after the other.
    Every pair with a gap of at most `skin` is a candidate.
    """
    pairs, m = _hard_pairs(x, skin, hard, radii)
    size = m + static.kind.size
    out = _empty_list(size)
    keys = np.empty(size, np.uint64)
    a = 0
    b = 0
    place = 0
    # merge the listed constraints and the pairs by family
    for k in range(size):
        if b == m or (a < static.kind.size and static.family[a] < pairs.family[b]):
            place = place + 1 if a > 0 and static.family[a] == static.family[a - 1] else 0
            out.kind[k] = static.kind[a]
            out.family[k] = static.family[a]
            out.i[k] = static.i[a]
            out.j[k] = static.j[a]
            out.p[k] = static.p[a]
            out.q[k] = static.q[a]
            out.d[k] = static.d[a]
            out.sign[k] = static.sign[a]
            out.dim[k] = static.dim[a]
            keys[k] = sweep_key(SORTED, 0, out.family[k], place, 0)
            a += 1
        else:
            out.kind[k] = PAIR
            out.family[k] = pairs.family[b]
            out.i[k] = pairs.i[b]
            out.j[k] = pairs.j[b]
            out.p[k] = pairs.p[b]
            out.q[k] = pairs.q[b]
            out.d[k] = pairs.d[b]
            out.sign[k] = 1.0
            out.dim[k] = pairs.dim[b]
            keys[k] = sweep_key(SORTED, 0, out.family[k], out.i[k], out.j[k])
            b += 1
    return out, keys


@inner_kernel
def gradient_pattern(
    contacts: ListedContacts, row_ptr: np.ndarray, row_cols: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the CSR pattern (ptr, cols) of the gradients; coordinates of i first, then of j.

    contacts: ListedContacts (m,); row_ptr, row_cols: pattern of the affine rows.
    """
    kind = contacts.kind
    p = contacts.p
    q = contacts.q
    dim = contacts.dim
    # Two passes: the lengths of the rows first, then their columns.
    ptr = np.zeros(kind.size + 1, np.int64)
    for k in range(kind.size):
        size = dim[k]
        if kind[k] == ROW:
            size = row_ptr[p[k] + 1] - row_ptr[p[k]]
        elif kind[k] == PAIR:
            size = 2 * dim[k]
        ptr[k + 1] = ptr[k] + size
    cols = np.empty(ptr[kind.size], np.int64)
    for k in range(kind.size):
        at = ptr[k]
        if kind[k] == ROW:
            for e in range(row_ptr[p[k]], row_ptr[p[k] + 1]):
                cols[at] = row_cols[e]
                at += 1
            continue
        for c in range(dim[k]):
            cols[at + c] = p[k] + c
            if kind[k] == PAIR:
                cols[at + dim[k] + c] = q[k] + c
    return ptr, cols


@inner_kernel
def carry_multipliers(keys: np.ndarray, mu: np.ndarray, new: np.ndarray) -> np.ndarray:
    """Return the multipliers mu of a list with keys `keys` for one with keys `new`; both ascend.

    keys, mu (m,); new (k,). Returns (k,), zero for what was not listed before.
    """
    out = np.zeros(new.size)
    c = 0
    # Merge of two ascending lists.
    for k in range(keys.size):
        if mu[k] > 0.0:
            while c < new.size and new[c] < keys[k]:
                c += 1
            if c < new.size and new[c] == keys[k]:
                out[c] = mu[k]
    return out
