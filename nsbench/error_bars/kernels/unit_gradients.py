"""Gaps and unit gradients of contacts, at one state or at many."""

from typing import NamedTuple

import numpy as np

from nsbench.compilation.borrowed_arrays import borrowed
from nsbench.compilation.decorators import fused_kernel, inner_kernel, njit
from nsbench.dynamics.contacts.kernels.contact_arrays import PAIR, ROW, SMOOTH, Contacts
from nsbench.linalg.skyline_cholesky import EnvelopePlan, arrange


UNPLANNED = np.int64(0)  # for n of `chosen`; a literal would compile a second version of it


class Constraints(NamedTuple):
    """Contacts, m of them, and the affine rows of their scene.

    ptr, cols, vals: the rows as CSR; lengths (rows,): of their gradients.
    """

    contacts: Contacts
    ptr: np.ndarray
    cols: np.ndarray
    vals: np.ndarray
    lengths: np.ndarray


class Rows(NamedTuple):
    """Some contacts of a list.

    at (m,): their places in it. C (m, w), count (m,): columns and number of the entries of their
    gradients. is_straight: are all of them affine rows? plan: of the factorisation of their Gram
    matrix (skyline_cholesky.arrange), empty for rows that `chosen` was not asked to plan it for.
    """

    at: np.ndarray
    C: np.ndarray
    count: np.ndarray
    is_straight: bool
    plan: EnvelopePlan


@fused_kernel
def _distance(contacts, k, x, ends):
    """Return the distance of a pair, or of a particle and its anchor, at x (n,)."""
    p = contacts.p[k]
    q = contacts.q[k]
    is_pair = contacts.kind[k] == PAIR
    s = 0.0
    for c in range(contacts.dim[k]):
        diff = x[p + c] - (x[q + c] if is_pair else ends[q + c])
        s += diff * diff
    return np.sqrt(s)


@fused_kernel
def _length(contacts, k):
    """Return the length of the gradient of a distance: of two particles it has two unit vectors."""
    return np.sqrt(2.0) if contacts.kind[k] == PAIR else 1.0


@fused_kernel
def _gap(scene, k, x, ends, b):
    """Return the gap of contact k at x (n,), divided by the length of its gradient."""
    contacts = scene.contacts
    if contacts.kind[k] != ROW:
        off = _distance(contacts, k, x, ends) - contacts.d[k]
        return contacts.sign[k] * off / _length(contacts, k)
    row = contacts.p[k]
    level = b[row]
    for e in range(scene.ptr[row], scene.ptr[row + 1]):
        level += scene.vals[e] * x[scene.cols[e]]
    return level / scene.lengths[row]


@inner_kernel
def _fill_gradient(scene, k, x, ends, v):
    """Fill v (w,) with the entries of the gradient of contact k at x (n,), scaled to length one."""
    contacts = scene.contacts
    p = contacts.p[k]
    q = contacts.q[k]
    if contacts.kind[k] == ROW:
        first = scene.ptr[p]
        for e in range(first, scene.ptr[p + 1]):
            v[e - first] = scene.vals[e] / scene.lengths[p]
        return
    is_pair = contacts.kind[k] == PAIR
    distance = _distance(contacts, k, x, ends)
    scale = contacts.sign[k] / (distance * _length(contacts, k)) if distance > 0.0 else 0.0
    dim = contacts.dim[k]
    for c in range(dim):
        e = scale * (x[p + c] - (x[q + c] if is_pair else ends[q + c]))
        v[c] = e
        if is_pair:
            v[dim + c] = -e


@inner_kernel
def fill_gaps(
    scene: Constraints,
    at: np.ndarray,
    anchors: np.ndarray,
    b: np.ndarray,
    x: np.ndarray,
    g: np.ndarray,
    V: np.ndarray,
) -> None:
    """Fill g (m,) with the gaps of the contacts `at` (m,) and V (m, w) with their gradients, both
    scaled to gradients of length 1.

    anchors (a,), b (rows,): as in Layout; x (n,): state. V (0, 0) asks for no gradients. What
    belongs to Smooth constraints is left as it is.
    """
    scene = borrowed(scene)
    for a in range(len(at)):
        k = at[a]
        if scene.contacts.kind[k] != SMOOTH:
            g[a] = _gap(scene, k, x, anchors, b)
            if len(V) > 0:
                _fill_gradient(scene, k, x, anchors, V[a])


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
    none = np.empty((0, 0))
    every = np.arange(len(scene.contacts.kind))
    for s in range(len(X)):
        ends = anchors[s if len(anchors) > 1 else 0]
        levels = b[s if len(b) > 1 else 0]
        fill_gaps(scene, every, ends, levels, X[s], g[s], V[s] if len(V) > 0 else none)


@inner_kernel
def every_row(scene: Constraints, columns: np.ndarray, count: np.ndarray, n: int) -> Rows:
    """Return all rows of a list; n as in `chosen`."""
    is_straight = True
    for kind in scene.contacts.kind:
        is_straight &= kind == ROW
    plan = arrange(columns, count, len(count) if n > 0 else 0, n)
    return Rows(np.arange(len(count)), columns, count, is_straight, plan)


@inner_kernel
def chosen(scene: Constraints, rows: Rows, is_chosen: np.ndarray, n: int) -> Rows:
    """Return those of the rows for which is_chosen (m,) is true; n: coordinates if their Gram
    matrix is to be factored, else 0."""
    m = 0
    for k in range(len(rows.at)):
        m += is_chosen[k]
    at = np.empty(m, np.int64)
    C = np.empty((m, rows.C.shape[1]), np.int64)
    count = np.empty(m, np.int64)
    is_straight = True
    a = 0
    for k in range(len(rows.at)):
        if is_chosen[k]:
            at[a] = rows.at[k]
            count[a] = rows.count[k]
            for e in range(rows.C.shape[1]):
                C[a, e] = rows.C[k, e]
            is_straight &= scene.contacts.kind[at[a]] == ROW
            a += 1
    return Rows(at, C, count, is_straight, arrange(C, count, m if n > 0 else 0, n))
