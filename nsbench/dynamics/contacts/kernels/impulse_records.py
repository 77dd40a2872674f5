"""Impulses by contact as growing records (sample, family, i, j, impulse).

A contact that never acts takes no memory.
"""

from collections.abc import Sequence

import numpy as np

from nsbench.compilation.decorators import njit

MANY = 10_000  # contacts; a tuple takes some 130 bytes for each, and half a microsecond


@njit(cache=True)
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


@njit(cache=True)
def sorted_contacts(ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sort the contacts of records ids (k, 4); return them, and the column of each record.

    Contacts (m, 3). The result of numpy.unique by a counting sort: places by family and i, then
    each short stretch is sorted by j.
    """
    # Number of families, and of the first indices in each: the ranges of the counting sort.
    families = 0
    for e in range(len(ids)):
        families = max(families, ids[e, 1] + 1)
    size = np.zeros(families + 1, np.int64)  # where a family begins
    for e in range(len(ids)):
        size[ids[e, 1] + 1] = max(size[ids[e, 1] + 1], ids[e, 2] + 1)
    for f in range(size.size - 1):
        size[f + 1] += size[f]
    ends = np.zeros(size[-1] + 1, np.int32)
    order = np.empty(len(ids), np.int32)
    column = np.empty(len(ids), np.int32)
    for e in range(len(ids)):
        ends[size[ids[e, 1]] + ids[e, 2] + 1] += 1
    # Counting sort: prefix sums, then records are placed by (family, i).
    for s in range(ends.size - 1):
        ends[s + 1] += ends[s]
    for e in range(len(ids)):
        at = size[ids[e, 1]] + ids[e, 2]
        order[ends[at]] = e
        ends[at] += 1  # to its end, the start of the next
    lo = 0
    m = 0
    for s in range(ends.size - 1):
        # Insertion sort by j: a particle has few partners.
        for e in range(lo, ends[s]):
            c = order[e]
            f = e
            while f > lo and ids[order[f - 1], 3] > ids[c, 3]:
                order[f] = order[f - 1]
                f -= 1
            order[f] = c
        for e in range(lo, ends[s]):
            m += e == lo or ids[order[e], 3] != ids[order[e - 1], 3]
            column[order[e]] = m - 1
        lo = ends[s]
    contacts = np.empty((m, 3), np.int32)
    for e in range(len(ids)):
        for c in range(3):
            contacts[column[e], c] = ids[e, c + 1]
    return contacts, column


def cumulate(ids: np.ndarray, values: np.ndarray, samples: int) -> tuple[Sequence, np.ndarray]:
    """Sum the records up to cumulative impulses by contact.

    ids (K, 4), values (K,): the records; samples: how many there are. Returns the sorted ids of the
    contacts that ever acted (a `Contacts` if there are many), and their cumulative impulse
    (samples, m).
    """
    if not len(values):
        return (), np.zeros((samples, 0))
    if len(values) > MANY and ids.dtype == np.int32:
        contacts, column = sorted_contacts(ids)
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
