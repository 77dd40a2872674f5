"""The choice of the next basis for the compiled walk, where it is left to the method with
look-ahead (see _selection).

With a drift f = A x + c at hand, discs that no closed contact and no entry of A joins go their ways
without each other: the velocity problem, its look-ahead too, falls into parts, and only those in
which something closed, opened or lost its load are solved. The others keep what they hold.
"""

from __future__ import annotations

import numpy as np

from nsbench.trajectory import Event

FEW = 300  # closed contacts: so few are chosen together, sooner than parts are found


def parts(drift) -> np.ndarray:
    """(n,) number of the part of each coordinate that the drift (ptr, cols, vals, c) joins."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import connected_components

    ptr, cols, _, c = drift
    return connected_components(
        csr_array((np.ones(len(cols)), cols, ptr), shape=(len(c), len(c))), directed=False
    )[1]


def choose(walk, label: np.ndarray, fired: int, entry: int) -> bool:
    """Choose basis and kept contacts of `walk` and write down what changed; False if the walk
    cannot go on like this.

    fired: entry of the list that just closed, or -1; entry: that, or the one whose multiplier
    vanished.
    """
    field = walk.field
    rows = walk.all
    g = field.gaps(walk.t, walk.x, rows)
    if not np.all(np.isfinite(g)):
        return False
    closed = g <= walk._band(rows)
    if fired >= 0:  # closed to the last digit of the time, whatever its speed makes of that
        closed[fired] = True
    held = np.zeros(len(rows), bool)
    held[walk.basis] = True
    changed = closed != walk.kept
    changed[entry] = True
    among = _touched(walk, label, closed | walk.kept, changed)
    index = np.flatnonzero(closed & among)
    choice = walk.selector.choose(
        walk.t, walk.x, field.take(rows, index), np.flatnonzero(held[index]), max(walk.paces)
    )
    if choice.stuck >= 0:
        return False
    kept = np.where(among, False, walk.kept)
    basis = np.where(among, False, held)
    kept[index[choice.kept]] = True
    basis[index[choice.basis]] = True
    for kind, which in (
        ("contact", kept & ~walk.kept),
        ("release", walk.kept & ~kept),
        ("pivot", kept & held & ~basis),
    ):
        walk.events += [Event(walk.t, kind, c) for c in rows.near.take(np.flatnonzero(which)).ids]
    walk.basis = np.flatnonzero(basis)
    walk.kept = kept
    walk.peak = max(walk.peak, int(kept.sum()))
    return True


def _touched(walk, label, active, changed) -> np.ndarray:
    """(m,) which entries belong to parts, joined by the active contacts and the drift, in which one
    has changed."""
    k = np.flatnonzero(active)
    if len(k) <= FEW:
        return np.ones(len(active), bool)
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    C, _, count = walk.field.gradients(walk.t, walk.x, walk.field.take(walk.all, k))
    a, e = np.nonzero(np.arange(C.shape[1]) < count[:, None])
    size = int(label.max()) + 1
    links = coo_array(
        (np.ones(len(a)), (label[C[a, e]], size + a)), shape=(size + len(k), size + len(k))
    )
    part = connected_components(links, directed=False)[1][size:]
    out = np.zeros(len(active), bool)
    out[k] = np.isin(part, part[changed[k]])
    return out
