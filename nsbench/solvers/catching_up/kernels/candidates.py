"""The list of a step: listed constraints and near pairs of hard particles, in the stated order,
with their pattern.

Written in plain loops: numba spends seconds on every slice that is assigned to another and on every
sort.
"""

import numpy as np

from nsbench.compilation.decorators import njit
from nsbench.dynamics.contacts.kernels.cell_list import near_pairs
from nsbench.dynamics.contacts.kernels.constraint_order import SORTED, sweep_key


@njit(cache=True, error_model="numpy")
def _pairs(x, skin, hard, radii):
    """Near pairs of all hard families, one after the other: family, i, j, first coordinates,
    distance, dim."""
    room = 64
    m = 0
    at = 0
    ints = np.empty((room, 6), np.int64)
    d = np.empty(room)
    for u in range(hard.shape[0]):
        family = hard[u, 0]
        start = hard[u, 1]
        n = hard[u, 2]
        dim = hard[u, 3]
        r = radii[at : at + n]
        at += n
        if n < 2:
            continue
        i, j = near_pairs(x, start, n, dim, r, skin)
        if m + i.size > room:
            room = 2 * (m + i.size)
            old = ints
            older = d
            ints = np.empty((room, 6), np.int64)
            d = np.empty(room)
            for k in range(m):
                d[k] = older[k]
                for c in range(6):
                    ints[k, c] = old[k, c]
        for k in range(i.size):
            ints[m, 0] = family
            ints[m, 1] = i[k]
            ints[m, 2] = j[k]
            ints[m, 3] = start + dim * i[k]
            ints[m, 4] = start + dim * j[k]
            ints[m, 5] = dim
            d[m] = r[i[k]] + r[j[k]]
            m += 1
    return ints, d, m


@njit(cache=True, error_model="numpy")
def gather(x, skin, static, hard, radii):
    """Candidates at x, sorted: arrays of kernels.project with family, i, j, and their keys
    (ascending).

    static: the listed constraints, by family; hard (families, 4): family, start, particles, dim, by
    family; radii of all hard families one after the other. Every pair with a gap of at most `skin`
    is a candidate.
    """
    ints, far, m = _pairs(x, skin, hard, radii)
    skind, sfamily, si, sj, sp, sq, sd, ssign, sdim = static
    size = m + skind.size
    kind = np.empty(size, np.int64)
    family = np.empty(size, np.int64)
    i = np.empty(size, np.int64)
    j = np.empty(size, np.int64)
    p = np.empty(size, np.int64)
    q = np.empty(size, np.int64)
    dim = np.empty(size, np.int64)
    d = np.empty(size)
    sign = np.empty(size)
    keys = np.empty(size, np.uint64)
    a = 0
    b = 0
    place = 0
    for k in range(size):
        if b == m or (a < skind.size and sfamily[a] < ints[b, 0]):
            place = place + 1 if a > 0 and sfamily[a] == sfamily[a - 1] else 0
            kind[k] = skind[a]
            family[k] = sfamily[a]
            i[k] = si[a]
            j[k] = sj[a]
            p[k] = sp[a]
            q[k] = sq[a]
            d[k] = sd[a]
            sign[k] = ssign[a]
            dim[k] = sdim[a]
            keys[k] = sweep_key(SORTED, 0, family[k], place, 0)
            a += 1
        else:
            kind[k] = 1
            family[k] = ints[b, 0]
            i[k] = ints[b, 1]
            j[k] = ints[b, 2]
            p[k] = ints[b, 3]
            q[k] = ints[b, 4]
            d[k] = far[b]
            sign[k] = 1.0
            dim[k] = ints[b, 5]
            keys[k] = sweep_key(SORTED, 0, family[k], i[k], j[k])
            b += 1
    return (kind, family, i, j, p, q, d, sign, dim), keys


@njit(cache=True, error_model="numpy")
def columns(lists, rptr, rcols):
    """CSR pattern (ptr, cols) of the gradients of a list; coordinates of i first, then of j."""
    kind = lists[0]
    p = lists[4]
    q = lists[5]
    dim = lists[8]
    ptr = np.zeros(kind.size + 1, np.int64)
    for k in range(kind.size):
        size = (
            rptr[p[k] + 1] - rptr[p[k]]
            if kind[k] == 0
            else (2 * dim[k] if kind[k] == 1 else dim[k])
        )
        ptr[k + 1] = ptr[k] + size
    cols = np.empty(ptr[kind.size], np.int64)
    for k in range(kind.size):
        at = ptr[k]
        if kind[k] == 0:
            for e in range(rptr[p[k]], rptr[p[k] + 1]):
                cols[at] = rcols[e]
                at += 1
            continue
        for c in range(dim[k]):
            cols[at + c] = p[k] + c
            if kind[k] == 1:
                cols[at + dim[k] + c] = q[k] + c
    return ptr, cols


@njit(cache=True, error_model="numpy")
def carry(keys, mu, new):
    """The multipliers of one list as those of another; keys ascending in both."""
    out = np.zeros(new.size)
    c = 0
    for k in range(keys.size):
        if mu[k] > 0.0:
            while c < new.size and new[c] < keys[k]:
                c += 1
            if c < new.size and new[c] == keys[k]:
                out[c] = mu[k]
    return out
