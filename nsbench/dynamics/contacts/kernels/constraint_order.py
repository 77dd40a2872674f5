"""Order of the constraints in a sweep, by a key of each constraint that no step or run changes.

The key is the same whichever list the constraint is in.

    sorted     families as the case lists them; within a family as listed, pairs of hard particles
               by (i, j)
    reverse    the same backwards
    random     one permutation of all constraints, drawn from the seed
    cell       sorted, with the particles of a hard family renumbered by `cell_ranks`: row by row of
               cells of the start
    coloured   sorted, but pairs of a hard family by (colour, i, j), where
               colour(i, j) = (mix(i) + mix(j) mod 2^64) div 2^60, one of 16, mix(i) = splitmix64 of
               label and seed

Colours depend on the labels alone: not on positions, time, lists or threads, and they never change.
Two pairs of one colour may share a particle (seldom, as mix is random); then (i, j) decides. What
may run at the same time follows from any of these orders by `colour_levels`: constraints of one
level share no particle, so they can be done in any order or all at once, level after level, with
the result of the sweep one after another, bit for bit. Of the pairs near each other in a random
packing of 10^6 discs the orders "random" and "coloured" have about 24 levels; "sorted", numbered
row by row, has thousands.
"""

import numpy as np

from nsbench.compilation.decorators import inner_kernel, njit

SORTED = 0
REVERSE = 1
RANDOM = 2
CELL = 3
COLOURED = 4
SHIFT = 28  # bits of a particle's index in a key: 2.7e8 particles
COLOUR_SHIFT = 26  # the same beside a colour: 6.7e7 particles
FAMILY_SHIFT = 2 * SHIFT  # 256 families


@inner_kernel
def mix(z: int) -> int:
    """Hash a 64-bit integer: splitmix64 (Steele, Lea & Flood 2014)."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@njit(cache=True)
def sweep_key(order: int, seed: int, family: int, a: int, b: int) -> int:
    """Return the key of a constraint by which a sweep is sorted.

    order: one of the codes of this module. a, b: particles i, j of a hard pair (their ranks, a < b,
    where the order is CELL), or the place in its family and 0.
    """
    if order == COLOURED and b > 0:
        # 2^64 over the golden ratio, the increment of splitmix64
        shift = np.uint64(seed + 1) * np.uint64(0x9E3779B97F4A7C15)
        # the highest four bits of the sum: one of 16 colours
        colour = (mix(np.uint64(a) + shift) + mix(np.uint64(b) + shift)) >> np.uint64(60)
        return (
            (np.uint64(family) << np.uint64(FAMILY_SHIFT))
            | (colour << np.uint64(2 * COLOUR_SHIFT))
            | (np.uint64(a) << np.uint64(COLOUR_SHIFT))
            | np.uint64(b)
        )
    key = (
        (np.uint64(family) << np.uint64(FAMILY_SHIFT))
        | (np.uint64(a) << np.uint64(SHIFT))
        | np.uint64(b)
    )
    if order == REVERSE:
        return ~key
    if order == RANDOM:
        return mix(key + np.uint64(seed + 1) * np.uint64(0x9E3779B97F4A7C15))
    return key


@inner_kernel
def places(family: np.ndarray) -> np.ndarray:
    """Return the place (m,) of each listed constraint within its family.

    Families are contiguous.
    """
    place = np.zeros(family.size, np.int64)
    for c in range(1, family.size):
        place[c] = place[c - 1] + 1 if family[c] == family[c - 1] else 0
    return place


@njit(cache=True)
def static_keys(family: np.ndarray, order: int, seed: int) -> np.ndarray:
    """Return the keys (m,) of listed constraints in the given order of the sweep.

    family (m,): of each constraint, contiguous; order: one of the codes of this module.
    """
    place = places(family)
    keys = np.empty(family.size, np.uint64)
    for c in range(family.size):
        keys[c] = sweep_key(order, seed, family[c], place[c], 0)
    return keys


@inner_kernel
def colour_levels(i: np.ndarray, j: np.ndarray, n: int) -> np.ndarray:
    """Return the levels (m,), from 0, of constraints listed in the order of the sweep.

    i, j (m,): particles below n of each constraint (j[c] < 0: on i[c] alone). A level is one more
    than that of the last constraint before it that shares a particle.
    """
    free = np.zeros(n, np.int32)
    level = np.empty(i.size, np.int32)
    # List scheduling: a constraint starts as soon as both of its particles are free.
    for c in range(i.size):
        a = i[c]
        b = j[c] if j[c] >= 0 else i[c]
        level[c] = max(free[a], free[b])
        free[a] = free[b] = level[c] + 1
    return level


def cell_ranks(x: np.ndarray, dim: int, size: float) -> np.ndarray:
    """Renumber particles row by row of cells of the given size.

    x (n dim,): coordinates. The last axis is the slowest, from the lowest corner; within a cell
    particles are ordered by label. Returns the new numbers (n,).
    """
    cell = np.floor((x.reshape(-1, dim) - x.reshape(-1, dim).min(axis=0, initial=np.inf)) / size)
    rank = np.empty(len(cell), np.int64)
    rank[np.lexsort(cell.T)] = np.arange(len(cell))
    return rank
