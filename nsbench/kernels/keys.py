"""The order of a sweep, defined by the scene: a key for every constraint, whoever lists it."""
import numpy as np
from numba import njit

SORTED, REVERSE, RANDOM = 0, 1, 2
SHIFT = 28                                   # bits of a particle's index in a key: 2.7e8 particles


@njit(cache=True)
def order_key(order, seed, family, a, b):
    """Place of a constraint in the sweep; a, b: particles i, j of a hard pair, or the place in its family and 0."""
    key = (np.uint64(family) << np.uint64(2 * SHIFT)) | (np.uint64(a) << np.uint64(SHIFT)) | np.uint64(b)
    if order == SORTED:
        return key
    if order == REVERSE:
        return ~key
    z = key + np.uint64(seed + 1) * np.uint64(0x9E3779B97F4A7C15)        # splitmix64 (Steele, Lea & Flood 2014)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@njit(cache=True)
def places(family):
    """Place of each listed constraint within its family; families are contiguous."""
    place = np.zeros(family.size, np.int64)
    for c in range(1, family.size):
        place[c] = place[c - 1] + 1 if family[c] == family[c - 1] else 0
    return place


@njit(cache=True)
def static_keys(family, order, seed):
    """Keys of listed constraints."""
    place, keys = places(family), np.empty(family.size, np.uint64)
    for c in range(family.size):
        keys[c] = order_key(order, seed, family[c], place[c], 0)
    return keys
