"""The constant of a random packing of equal discs as a function of independent uniform numbers.

The packings are those of nsbench.studies.packings.contact_graphs.grow (radii 1, in the plane), the
orders uniform permutations. Disc k makes attempts t = 0, 1, ... with the numbers (p, q, r, s) of
each: at disc p in direction r, or, where q < loops, at p and one of its nearest, r, on side s. The
first place that is clear is taken. Contacts have keys of their own, and are swept in their order.
"""

import numpy as np

from nsbench.compilation.decorators import inner_kernel, njit
from nsbench.studies.lemma.kernels.worst_case import worst_of_order

REACH = 2.0  # between centres of discs that touch
NEAREST = 5  # discs that may be touched together with another


@inner_kernel
def _square(centres, i, j):
    """Return the square of the distance of two centres."""
    x = centres[i, 0] - centres[j, 0]
    y = centres[i, 1] - centres[j, 1]
    return x * x + y * y


@inner_kernel
def _choose(number, count):
    """Return one of 0 .. count - 1 from a number in [0, 1)."""
    return min(int(number * count), count - 1)


@inner_kernel
def _find_near(centres, count, first, number):
    """Return one of the NEAREST discs of the disc `first`, chosen by a number in [0, 1).

    They are counted by index: distances of discs that touch it are equal up to rounding.
    """
    choices = min(NEAREST, count - 1)
    left = _choose(number, choices)
    for i in range(count):
        if i != first:
            nearer = 0
            square = _square(centres, i, first)
            for j in range(count):
                if j != first and j != i:
                    other = _square(centres, j, first)
                    nearer += other < square or (other == square and j < i)
            if nearer < choices:
                if left == 0:
                    return i
                left -= 1
    return -1


@inner_kernel
def _propose(numbers, k, t, loops, centres, touched):
    """Write the place of disc k in attempt t to centres[k]; returns how many it touches, 0: none.

    touched (2,): the discs that it touches, written.
    """
    first = _choose(numbers[k, t, 0], k)
    touched[0] = first
    if k < 2 or numbers[k, t, 1] >= loops:
        angle = 2.0 * np.pi * numbers[k, t, 2]
        centres[k, 0] = centres[first, 0] + REACH * np.cos(angle)
        centres[k, 1] = centres[first, 1] + REACH * np.sin(angle)
        return 1
    other = _find_near(centres, k, first, numbers[k, t, 2])
    touched[1] = other
    height = REACH * REACH / _square(centres, first, other) - 0.25
    if height <= 0.0:
        return 0
    height = np.sqrt(height) if numbers[k, t, 3] < 0.5 else -np.sqrt(height)
    x = centres[other, 0] - centres[first, 0]
    y = centres[other, 1] - centres[first, 1]
    centres[k, 0] = centres[first, 0] + 0.5 * x - height * y
    centres[k, 1] = centres[first, 1] + 0.5 * y + height * x
    return 2


@inner_kernel
def _is_clear(centres, k, touched, contacts, clearance):
    """Tell whether disc k keeps its clearance from all discs before it that it does not touch."""
    for i in range(k):
        if i != touched[0] and (contacts == 1 or i != touched[1]):
            if np.sqrt(_square(centres, i, k)) - REACH < clearance:
                return False
    return True


@inner_kernel
def grow_uniform(numbers, loops, clearance, centres, pairs):
    """Grow a packing from uniform numbers (n, attempts, 4); returns its number of contacts.

    centres (n, 2), pairs (2 n, 2): written. Returns -1 where no attempt of a disc finds a place.
    """
    touched = np.zeros(2, np.int64)
    m = 0
    for k in range(1, len(centres)):
        contacts = 0
        for t in range(numbers.shape[1]):
            contacts = _propose(numbers, k, t, loops, centres, touched)
            if contacts > 0 and _is_clear(centres, k, touched, contacts, clearance):
                break
            contacts = 0
        if contacts == 0:
            return -1
        for i in range(contacts):
            pairs[m, 0] = touched[i]
            pairs[m, 1] = k
            m += 1
    return m


@inner_kernel
def _entry(centres, pairs, k, other):
    """Return the entry of the Gram matrix for two contacts; 0 where they share no disc."""
    value = 0.0
    for i in range(2):
        for j in range(2):
            shared = pairs[k, i]
            if shared == pairs[other, j]:
                first = pairs[k, 1 - i]
                second = pairs[other, 1 - j]
                for axis in range(2):
                    a = centres[first, axis] - centres[shared, axis]
                    b = centres[second, axis] - centres[shared, axis]
                    value += a * b / (2.0 * REACH * REACH)
    return value


@njit(cache=True, error_model="numpy")
def constant_of_numbers(numbers, keys, loops, clearance, orthogonal):
    """Return C, by coordinate ascent, of a packing and an order from uniform numbers; -1: none.

    numbers (n, attempts, 4), keys (n, 2): of the contacts of each disc with those before it.
    orthogonal: entries of A below it are rounding of 0.
    """
    n = len(keys)
    centres = np.zeros((n, 2))
    pairs = np.zeros((2 * n, 2), np.int64)
    m = grow_uniform(numbers, loops, clearance, centres, pairs)
    if m < 0:
        return -1.0
    order = np.zeros(m, np.int64)
    ptr = np.zeros(m + 1, np.int64)
    cols = np.zeros(m * m, np.int64)
    vals = np.zeros(m * m)
    end = 0
    for k in range(m):
        place = 0
        # a contact is the second one of its disc where the one before is of the same disc
        own = keys[pairs[k, 1], int(k > 0 and pairs[k - 1, 1] == pairs[k, 1])]
        for other in range(m):
            if other != k:
                second = int(other > 0 and pairs[other - 1, 1] == pairs[other, 1])
                key = keys[pairs[other, 1], second]
                place += key < own or (key == own and other < k)
                value = _entry(centres, pairs, k, other)
                if abs(value) >= orthogonal:
                    cols[end] = other
                    vals[end] = value
                    end += 1
        order[place] = k
        ptr[k + 1] = end
    return worst_of_order(ptr, cols, vals, order)
