"""Gaps and unit gradients of contacts at many states, and the first gap that closes on a cubic."""

from typing import NamedTuple

import numpy as np

from nsbench.compilation.decorators import inner_kernel, njit
from nsbench.dynamics.contacts.kernels.contact_arrays import PAIR, ROW, SMOOTH, Contacts


class ContactEntries(NamedTuple):
    """Contacts, m of them, with the entries of their gradients.

    columns (m, w), count (m,): coordinates of the entries. rows (m, w), lengths (m,): entries and
    lengths of the gradients of affine rows.
    """

    contacts: Contacts
    columns: np.ndarray
    count: np.ndarray
    rows: np.ndarray
    lengths: np.ndarray


@inner_kernel
def _gap(entries, k, x, anchors, b, v):
    """Return the gap of contact k at x (n,), divided by the length of its gradient; fill v with the
    entries of that gradient, scaled to length one, or v (0,) with none."""
    if entries.contacts.kind[k] != ROW:
        return _distance(entries.contacts, k, x, anchors, v)
    level = b[entries.contacts.p[k]]
    for e in range(entries.count[k]):
        level += entries.rows[k, e] * x[entries.columns[k, e]]
        if len(v) > 0:
            v[e] = entries.rows[k, e] / entries.lengths[k]
    return level / entries.lengths[k]


@inner_kernel
def _distance(contacts, k, x, ends, v):
    """Return the gap of the distance k at x (n,), divided by the length of its gradient; fill v
    with the entries of that gradient, scaled to length one, or v (0,) with none."""
    p = contacts.p[k]
    q = contacts.q[k]
    dim = contacts.dim[k]
    is_pair = contacts.kind[k] == PAIR
    s = 0.0
    for c in range(dim):
        diff = x[p + c] - (x[q + c] if is_pair else ends[q + c])
        s += diff * diff
    distance = np.sqrt(s)
    # the gradient of a distance of two particles has two unit vectors
    length = np.sqrt(2.0) if is_pair else 1.0
    if len(v) > 0:
        scale = contacts.sign[k] / (distance * length) if distance > 0.0 else 0.0
        for c in range(dim):
            e = scale * (x[p + c] - (x[q + c] if is_pair else ends[q + c]))
            v[c] = e
            if is_pair:
                v[dim + c] = -e
    return contacts.sign[k] * (distance - contacts.d[k]) / length


@njit(cache=True, error_model="numpy")
def gaps_and_gradients(
    entries: ContactEntries,
    anchors: np.ndarray,
    b: np.ndarray,
    X: np.ndarray,
    g: np.ndarray,
    V: np.ndarray,
) -> None:
    """Fill g (K, m) with gaps and V (K, m, w) with gradients, both scaled to gradients of length 1.

    anchors (K, a), b (K, rows): as in Layout at the K times, or once where they do not move. X
    (K, n): states. V (0, m, w) asks for no gradients. What belongs to Smooth constraints is left as
    it is.
    """
    none = np.empty(0)
    for s in range(len(X)):
        ends = anchors[s if len(anchors) > 1 else 0]
        levels = b[s if len(b) > 1 else 0]
        for k in range(len(entries.count)):
            if entries.contacts.kind[k] != SMOOTH:
                g[s, k] = _gap(entries, k, X[s], ends, levels, V[s, k] if len(V) > 0 else none)


@inner_kernel
def _least_gap(entries, anchors, b, powers, w, x):
    """Return the least gap at the state that the cubic with the coefficients powers (4, n) has at
    w, which fills x (n,)."""
    none = np.empty(0)
    # Horner's rule
    x[:] = 0.0
    for p in range(len(powers) - 1, -1, -1):
        for c in range(len(x)):
            x[c] = powers[p, c] + w * x[c]
    least = np.inf
    for k in range(len(entries.count)):
        gap = _gap(entries, k, x, anchors, b, none)
        # a gap that is not a number closes at once
        if not gap >= least:
            least = gap
    return least


@njit(cache=True, error_model="numpy")
def first_closing(
    entries: ContactEntries,
    anchors: np.ndarray,
    b: np.ndarray,
    powers: np.ndarray,
    looks: np.ndarray,
    closed: float,
    bits: int,
) -> float:
    """Return where on a cubic the least gap falls below `closed`, seen at the first of the
    ascending places looks (k,) with a negative one; infinity where none has.

    powers (4, n): coefficients of the cubic. Bisection to looks / 2^bits; at the place that is
    returned the least gap is below `closed`. anchors (1, a), b (1, rows): of constraints that rest;
    no contact is one of a Smooth constraint.
    """
    x = np.empty(powers.shape[1])
    for look in looks:
        if not _least_gap(entries, anchors[0], b[0], powers, look, x) >= 0.0:
            low = 0.0
            high = look
            for _ in range(bits):
                middle = 0.5 * (low + high)
                if _least_gap(entries, anchors[0], b[0], powers, middle, x) >= closed:
                    low = middle
                else:
                    high = middle
            return high
    return np.inf
