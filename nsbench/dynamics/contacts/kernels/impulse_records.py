"""Impulses by contact as growing records (sample, family, i, j, impulse).

A contact that never acts takes no memory.
"""

from collections.abc import Sequence

import numpy as np

from nsbench.compilation.decorators import inner_kernel, njit

MANY = 10_000  # contacts; a tuple takes some 130 bytes for each, and half a microsecond
FEW = 1000  # records; with more, a compiled counting sort takes a fifth of the time of numpy.unique
SPARSE = 16  # numbers that its keys may take, over the records: it counts each of them


@inner_kernel
def flush(
    k: int,
    mu: np.ndarray,
    family: np.ndarray,
    i: np.ndarray,
    j: np.ndarray,
    ids: np.ndarray,
    values: np.ndarray,
    count: int,
) -> tuple[np.ndarray, np.ndarray, int]:
    """Append the impulses mu of a list to the records, as of sample k, and set them to zero.

    mu, family, i, j (m,): impulses and ids of the listed contacts. ids (K, 4), values (K,): the
    records, `count` of them in use. Returns the records, enlarged where they were full.
    """
    need = 0
    for c in range(mu.size):
        if mu[c] != 0.0:
            need += 1
    # Geometric growth: an entry is copied a bounded number of times on average.
    if count + need > values.size:
        more = np.empty((3 * values.size + need, 4), np.int64)
        large = np.empty(3 * values.size + need)
        for c in range(count):
            large[c] = values[c]
            for e in range(4):
                more[c, e] = ids[c, e]
        ids = more
        values = large
    for c in range(mu.size):
        if mu[c] != 0.0:
            ids[count, 0] = k
            ids[count, 1] = family[c]
            ids[count, 2] = i[c]
            ids[count, 3] = j[c]
            values[count] = mu[c]
            mu[c] = 0.0
            count += 1
    return ids, values, count


class Contacts(Sequence):
    """Sequence of contact ids, equal to a tuple of tuples, stored as an array.

    ids (m, 3): family, i, j, with j = -1 where there is no second index.
    """

    def __init__(self, ids: np.ndarray):
        self.ids = ids

    def __len__(self) -> int:
        return len(self.ids)

    def __getitem__(self, index):
        if isinstance(index, slice):
            return Contacts(self.ids[index])
        return _name(self.ids[index].tolist())

    def __iter__(self):
        return map(_name, self.ids.tolist())

    def __eq__(self, other) -> bool:
        if isinstance(other, Contacts):
            return np.array_equal(self.ids, other.ids)
        return (
            isinstance(other, tuple)
            and len(self) == len(other)
            and all(a == b for a, b in zip(self, other, strict=True))
        )

    def __hash__(self) -> int:
        return hash(tuple(self))


def _name(id_):
    """Return the id (3,) of a contact as a tuple, without a second index of -1."""
    family, i, j = id_
    return (family, i, j) if j >= 0 else (family, i)


@inner_kernel
def sort_stably(key: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Return the indices `order` (k,) sorted by key[order] >= 0, a key's own in their old order."""
    # counting sort: how many have a smaller key, then each to its place
    most = 0
    for k in key:
        most = max(most, k)
    ends = np.zeros(most + 2, np.int32)
    for e in range(key.size):
        ends[key[e] + 1] += 1
    for s in range(ends.size - 1):
        ends[s + 1] += ends[s]
    out = np.empty_like(order)
    for e in range(order.size):
        out[ends[key[order[e]]]] = order[e]
        ends[key[order[e]]] += 1
    return out


@njit(cache=True)
def sorted_contacts(ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sort the contacts of records ids (k, 4); return them, and the column of each record.

    Contacts (m, 3). The result of numpy.unique by counting sorts, the last index first.
    """
    records = len(ids)
    # Number of families, and of the first indices in each: the range of the second sort.
    families = 0
    for e in range(records):
        families = max(families, ids[e, 1] + 1)
    size = np.zeros(families + 1, np.int64)  # where a family begins
    for e in range(records):
        size[ids[e, 1] + 1] = max(size[ids[e, 1] + 1], ids[e, 2] + 1)
    for f in range(size.size - 1):
        size[f + 1] += size[f]
    first = np.empty(records, np.int32)
    second = np.empty(records, np.int32)
    for e in range(records):
        first[e] = size[ids[e, 1]] + ids[e, 2]
        second[e] = ids[e, 3] + 1
    order = sort_stably(first, sort_stably(second, np.arange(records).astype(np.int32)))
    column = np.empty(records, np.int32)
    contacts = np.empty((records, 3), np.int32)
    m = 0
    for e in range(records):
        c = order[e]
        if e == 0 or first[c] != first[order[e - 1]] or second[c] != second[order[e - 1]]:
            contacts[m, 0] = ids[c, 1]
            contacts[m, 1] = ids[c, 2]
            contacts[m, 2] = ids[c, 3]
            m += 1
        column[c] = m - 1
    return contacts[:m].copy(), column


def cumulate(ids: np.ndarray, values: np.ndarray, samples: int) -> tuple[Sequence, np.ndarray]:
    """Sum the records up to cumulative impulses by contact.

    ids (K, 4), values (K,): the records; samples: how many there are. Returns the sorted ids of the
    contacts that ever acted (a `Contacts` if there are many), and their cumulative impulse
    (samples, m).
    """
    if not len(values):
        return (), np.zeros((samples, 0))
    _, family, i, j = ids.max(axis=0).tolist()
    if len(values) > FEW and (family + 1) * (i + 1) + j < SPARSE * len(values):
        contacts, column = sorted_contacts(ids.astype(np.int32, copy=False))
    elif (
        ids.max() < 2**27 and ids[:, 1].max() < 2**7
    ):  # one word for each id: sorted much faster, in the same order
        words = (
            (ids[:, 1].astype(np.int64) << 56)
            | (ids[:, 2].astype(np.int64) << 28)
            | (ids[:, 3].astype(np.int64) + 1)
        )
        words, column = np.unique(words, return_inverse=True)
        contacts = np.stack(
            (words >> 56, (words >> 28) & (2**28 - 1), (words & (2**28 - 1)) - 1), axis=1
        ).astype(ids.dtype)
        del words
    else:
        contacts, column = np.unique(ids[:, 1:], axis=0, return_inverse=True)
    entry = ids[:, 0].astype(np.int64) * len(contacts) + column.ravel()
    impulse = np.bincount(entry, values, samples * len(contacts))
    impulse = impulse.reshape(samples, len(contacts))
    names = Contacts(contacts) if len(contacts) > MANY else tuple(map(_name, contacts.tolist()))
    return names, np.cumsum(impulse, axis=0, out=impulse)
