"""Impulses by contact as growing records (sample, family, i, j, impulse): what never acts takes no room."""
import numpy as np
from numba import njit


@njit(cache=True)
def flush(k, mu, family, i, j, ids, values, count):
    """Move the impulses mu of a list to the records of sample k and clear them; returns grown records."""
    need = 0
    for c in range(mu.size):
        if mu[c] != 0.0:
            need += 1
    if count + need > values.size:
        room = 2 * values.size + need
        ids = np.concatenate((ids, np.empty((room, 4), np.int64)))
        values = np.concatenate((values, np.empty(room)))
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


def cumulate(ids: np.ndarray, values: np.ndarray, samples: int) -> tuple[tuple, np.ndarray]:
    """Contact ids that ever acted, sorted, and their cumulative impulse (samples, m)."""
    if not len(values):
        return (), np.zeros((samples, 0))
    contacts, column = np.unique(ids[:, 1:], axis=0, return_inverse=True)
    impulse = np.zeros((samples, len(contacts)))
    np.add.at(impulse, (ids[:, 0], column.ravel()), values)
    names = tuple((f, i) if j < 0 else (f, i, j) for f, i, j in contacts.tolist())
    return names, np.cumsum(impulse, axis=0)
