"""Gaps and unit gradients of contacts at many states, and the first gap that closes on a cubic."""

from typing import NamedTuple

import numpy as np

from nsbench.compilation.borrowed_arrays import borrowed
from nsbench.compilation.decorators import inner_kernel, njit
from nsbench.dynamics.contacts.kernels.contact_arrays import PAIR, ROW, SMOOTH, Contacts


class Constraints(NamedTuple):
    """Contacts, m of them, and the affine rows of their scene.

    ptr, cols, vals: the rows as CSR; lengths (rows,): of their gradients.
    """

    contacts: Contacts
    ptr: np.ndarray
    cols: np.ndarray
    vals: np.ndarray
    lengths: np.ndarray


@inner_kernel
def _gap(scene, k, x, anchors, b, v):
    """Return the gap of contact k at x (n,), divided by the length of its gradient; fill v with the
    entries of that gradient, scaled to length one, or v (0,) with none."""
    if scene.contacts.kind[k] != ROW:
        return _distance(scene.contacts, k, x, anchors, v)
    row = scene.contacts.p[k]
    length = scene.lengths[row]
    level = b[row]
    first = scene.ptr[row]
    for e in range(first, scene.ptr[row + 1]):
        level += scene.vals[e] * x[scene.cols[e]]
        if len(v) > 0:
            v[e - first] = scene.vals[e] / length
    return level / length


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
    scene: Constraints,
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
    scene = borrowed(scene)
    none = np.empty(0)
    for s in range(len(X)):
        ends = anchors[s if len(anchors) > 1 else 0]
        levels = b[s if len(b) > 1 else 0]
        for k in range(len(scene.contacts.kind)):
            if scene.contacts.kind[k] != SMOOTH:
                g[s, k] = _gap(scene, k, X[s], ends, levels, V[s, k] if len(V) > 0 else none)


@inner_kernel
def _fill_state(powers, w, x):
    """Fill x (n,) with the state that the cubic with the coefficients powers (4, n) has at w."""
    # Horner's rule
    x[:] = 0.0
    for p in range(len(powers) - 1, -1, -1):
        for c in range(len(x)):
            x[c] = powers[p, c] + w * x[c]


@njit(cache=True, error_model="numpy")
def first_closing(
    scene: Constraints,
    anchors: np.ndarray,
    b: np.ndarray,
    powers: np.ndarray,
    looks: np.ndarray,
    closed: float,
    bits: int,
) -> float:
    """Return where on a cubic the first gap falls below `closed`, of those that are negative at the
    first of the ascending places looks (k,) at which one is; infinity where none ever is.

    powers (4, n): coefficients of the cubic. Bisection to looks / 2^bits; at the place that is
    returned one of these gaps is below `closed`. anchors (1, a), b (1, rows): of constraints that
    rest; no contact is one of a Smooth constraint.
    """
    scene = borrowed(scene)
    none = np.empty(0)
    x = np.empty(powers.shape[1])
    late = np.empty(len(scene.contacts.kind), np.int64)
    for look in looks:
        _fill_state(powers, look, x)
        found = 0
        for k in range(len(late)):
            # a gap that is not a number closes at once
            if not _gap(scene, k, x, anchors[0], b[0], none) >= 0.0:
                late[found] = k
                found += 1
        if found == 0:
            continue
        low = 0.0
        high = look
        for _ in range(bits):
            middle = 0.5 * (low + high)
            _fill_state(powers, middle, x)
            is_open = True
            for a in range(found):
                is_open &= _gap(scene, late[a], x, anchors[0], b[0], none) >= closed
            if is_open:
                low = middle
            else:
                high = middle
        return high
    return np.inf
