"""Neighbour lists of hard particles, joined with the listed constraints in the order of the sweep.

A list holds the listed constraints and every pair whose gap is at most the cutoff, sorted by keys
(constraint_order), so that the order of the sweep is defined by the scene and never by the list.
"""

from typing import NamedTuple

import numpy as np

from nsbench.compilation.decorators import inner_kernel, njit
from nsbench.dynamics.contacts.kernels.cell_list import near_pairs
from nsbench.dynamics.contacts.kernels.constraint_order import sweep_key
from nsbench.dynamics.contacts.kernels.contact_arrays import PAIR, ListedContacts


class HardScene(NamedTuple):
    """What does not change during a run.

    static: ListedContacts of the listed constraints. hard (k, 4): family, first coordinate,
    particles, dimension of each hard family. radii, ranks: of all hard particles, family after
    family; ranks order the pairs, empty: by label. owner (n, 2): first coordinate and dimension of
    the hard particle that a coordinate belongs to, -1 if none. order, seed: of the sweep.
    """

    static: ListedContacts
    hard: np.ndarray
    radii: np.ndarray
    ranks: np.ndarray
    owner: np.ndarray
    order: int
    seed: int


@inner_kernel
def joined(a: np.ndarray, b: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Return a (m,) with the chosen entries of b behind it; chosen (k,): their indices."""
    out = np.empty(a.size + chosen.size, a.dtype)
    for c in range(a.size):
        out[c] = a[c]
    for c in range(chosen.size):
        out[a.size + c] = b[chosen[c]]
    return out


@inner_kernel
def append(
    lists: ListedContacts,
    keys: np.ndarray,
    other: ListedContacts,
    other_keys: np.ndarray,
    chosen: np.ndarray,
) -> tuple[ListedContacts, np.ndarray]:
    """Return lists and keys (m,) with the chosen entries of another list behind them.

    chosen (k,): indices of those entries. Returns a list and keys of length m + k.
    """
    return ListedContacts(
        joined(lists.kind, other.kind, chosen),
        joined(lists.family, other.family, chosen),
        joined(lists.i, other.i, chosen),
        joined(lists.j, other.j, chosen),
        joined(lists.p, other.p, chosen),
        joined(lists.q, other.q, chosen),
        joined(lists.d, other.d, chosen),
        joined(lists.sign, other.sign, chosen),
        joined(lists.dim, other.dim, chosen),
    ), joined(keys, other_keys, chosen)


@inner_kernel
def ascending(keys: np.ndarray) -> np.ndarray:
    """Return the order (m,) in which keys (m,) ascend.

    Natural merge sort: runs that ascend already are merged two by two.
    """
    # The runs that ascend already: a list behind a list makes two.
    m = keys.size
    order = np.arange(m)
    other = np.empty(m, np.int64)
    ends = np.empty(m + 1, np.int64)
    runs = 0
    ends[0] = 0
    for c in range(1, m + 1):
        if c == m or keys[c] < keys[c - 1]:
            runs += 1
            ends[runs] = c
    # Merge sort, bottom up.
    while runs > 1:
        left = 0
        for u in range(0, runs, 2):
            lo = ends[u]
            mid = ends[u + 1]
            hi = ends[min(u + 2, runs)]
            a = lo
            b = mid
            for c in range(lo, hi):
                if b == hi or (a < mid and keys[order[a]] <= keys[order[b]]):
                    other[c] = order[a]
                    a += 1
                else:
                    other[c] = order[b]
                    b += 1
            left += 1
            ends[left] = hi
        order, other, runs = other, order, left
    return order


@inner_kernel
def no_contacts() -> ListedContacts:
    """Return an empty list."""
    none = np.empty(0, np.int64)
    empty = np.empty(0)
    return ListedContacts(none, none, none, none, none, none, empty, empty, none)


@inner_kernel
def in_order(lists: ListedContacts, keys: np.ndarray) -> tuple[ListedContacts, np.ndarray]:
    """Return lists and keys (m,) sorted by key; as they are where they ascend already."""
    up = True
    down = True
    for c in range(1, keys.size):
        up = up and keys[c - 1] < keys[c]
        down = down and keys[c - 1] > keys[c]
    if up:
        return lists, keys
    if down:
        order = np.empty(keys.size, np.int64)
        for c in range(keys.size):
            order[c] = keys.size - 1 - c
    else:
        order = ascending(keys)
    return append(no_contacts(), np.empty(0, np.uint64), lists, keys, order)


@inner_kernel
def insertion_places(keys: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return where each of the wanted keys (k,) stands among the keys (m,), or would; both
    ascend."""
    at = np.empty(wanted.size, np.int64)
    place = 0
    for c in range(wanted.size):
        while place < keys.size and keys[place] < wanted[c]:
            place += 1
        at[c] = place
    return at


@inner_kernel
def pairs_of(
    family: int, i: np.ndarray, j: np.ndarray, start: int, dim: int, r: np.ndarray
) -> ListedContacts:
    """Return the list of the pairs i, j (m,) of a family of hard particles.

    start: coordinate at which the family begins; r (n,): radii of its particles.
    """
    m = i.size
    one = np.empty(m, np.int64)
    fam = np.empty(m, np.int64)
    p = np.empty(m, np.int64)
    q = np.empty(m, np.int64)
    dims = np.empty(m, np.int64)
    d = np.empty(m)
    sign = np.empty(m)
    for c in range(m):
        one[c] = PAIR
        fam[c] = family
        dims[c] = dim
        sign[c] = 1.0
        p[c] = start + dim * i[c]
        q[c] = start + dim * j[c]
        d[c] = r[i[c]] + r[j[c]]
    return ListedContacts(one, fam, i, j, p, q, d, sign, dims)


@njit(cache=True)
def near_list(
    x: np.ndarray, reach: float, scene: HardScene, static_keys: np.ndarray
) -> tuple[ListedContacts, np.ndarray]:
    """Return the listed constraints and the pairs near x (n,) in the order of the sweep, with keys.

    reach: largest gap of a pair; scene: HardScene; static_keys: of the listed constraints.
    """
    # listed constraints, then the near pairs of each family; sorted by key in the end
    lists = scene.static
    keys = static_keys
    order = scene.order
    seed = scene.seed
    by_rank = scene.ranks.size > 0
    at = 0
    for u in range(scene.hard.shape[0]):
        fam, start, n, dm = scene.hard[u]
        r = scene.radii[at : at + n]
        number = scene.ranks[at : at + n]
        at += n
        if n < 2:
            continue
        i, j = near_pairs(x, start, n, dm, r, reach)
        m = i.size
        k = np.empty(m, np.uint64)
        for c in range(m):
            if by_rank:
                a = number[i[c]]
                b = number[j[c]]
                k[c] = sweep_key(order, seed, fam, min(a, b), max(a, b))
            else:
                k[c] = sweep_key(order, seed, fam, i[c], j[c])
        lists, keys = append(lists, keys, pairs_of(fam, i, j, start, dm, r), k, np.arange(m))
    return in_order(lists, keys)


@inner_kernel
def rebuild(
    old: ListedContacts,
    old_keys: np.ndarray,
    mu: np.ndarray,
    x: np.ndarray,
    reach: float,
    scene: HardScene,
    static_keys: np.ndarray,
) -> tuple[ListedContacts, np.ndarray, np.ndarray]:
    """Return a new list at x (n,), its keys (k,), and the impulses mu of the old list as its own.

    old, old_keys, mu (m,): the old list, its keys and impulses; reach: largest gap of a pair.
    Pairs that have acted since the last sample stay in the list, so that an impulse is summed in
    the same order as over all pairs, and agrees with that to the last bit.
    """
    lists, keys = near_list(x, reach, scene, static_keys)
    # what has acted and is no longer near stays listed until its impulse is recorded
    at = insertion_places(keys, old_keys)
    gone = np.empty(old_keys.size, np.int64)
    m = 0
    for c in range(old_keys.size):
        if mu[c] != 0.0 and (at[c] == keys.size or keys[at[c]] != old_keys[c]):
            gone[m] = c
            m += 1
    if m > 0:
        lists, keys = append(lists, keys, old, old_keys, gone[:m])
        lists, keys = in_order(lists, keys)
        at = insertion_places(keys, old_keys)
    new = np.zeros(keys.size)
    for c in range(old_keys.size):
        if mu[c] != 0.0:
            new[at[c]] = mu[c]
    return lists, keys, new
