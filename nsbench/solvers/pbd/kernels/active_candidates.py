"""The few candidates of a list that can become active soon: swept over in its place, for some
steps.

A list of near pairs lives long and is dear to make, so it is long: in a dense packing three of four
of its candidates do nothing. Out of it those are chosen, in the same order, whose gap is at most a
smaller skin; nothing else can become active while no particle is farther than half of that from
where they were chosen. Choosing reads the list once.
"""

import numpy as np

from nsbench.compilation.decorators import njit

# of reading a list once against a step of the sweep over what it grows by, per radius: estimated
FAVOUR = 2.4


@njit(cache=True, error_model="numpy")
def row_gap(y, s, q, rows, b, dim):
    """Value of row q at particle s."""
    ptr, cols, vals, _ = rows
    g = b[q]
    for e in range(ptr[q], ptr[q + 1]):
        g += vals[e] * y[s * dim + cols[e] % dim]
    return g


@njit(cache=True, error_model="numpy")
def select_active(lists, chosen, y, r, skin, dim, rows, b, moving):
    """Fill `chosen` (i, j, where, mu) with the candidates whose gap is at most skin, rows of moving
    walls all of them.

    lists: i, j, mu of all candidates. Returns the number chosen.
    """
    i, j, mu = lists
    near_i, near_j, where, near_mu = chosen
    d = 2.0 * r[0] + skin
    k = np.uint64(0)
    alike = r.size == 1
    one = np.uint64(1)
    two = np.uint64(2)
    plane = dim == 2 and r.size == 1
    d2 = d * d
    for c in range(i.size):
        near_i[k] = i[c]
        near_j[k] = j[c]
        where[k] = c
        if j[c] < 0:
            q = -1 - j[c]
            g = row_gap(y, i[c], q, rows, b, dim)
            k += np.uint64(moving or g * abs(g) * rows[3][q] <= 0.25 * skin * skin)
        elif plane:
            p = two * np.uint64(i[c])
            q = two * np.uint64(j[c])
            u = y[p] - y[q]
            v = y[p + one] - y[q + one]
            k += np.uint64(u * u + v * v <= d2)
        else:
            if not alike:
                d = r[i[c]] + r[j[c]] + skin
            s = 0.0
            for e in range(dim):
                u = y[i[c] * dim + e] - y[j[c] * dim + e]
                s += u * u
            k += np.uint64(s <= d * d)
    for c in range(k):
        near_mu[c] = mu[where[c]]
    return np.int64(k)


@njit(cache=True)
def restore_impulses(mu, where, near_mu):
    """Impulses of the chosen to the list."""
    for c in range(where.size):
        mu[where[c]] = near_mu[c]


@njit(cache=True)
def inner_skin(pace, radius, skin):
    """The skin of a choice: what costs least if particles go `pace` in a step, at most 0.6 of that
    of the list."""
    return min(0.6 * skin, max(0.1 * skin, np.sqrt(FAVOUR * pace * radius)))
