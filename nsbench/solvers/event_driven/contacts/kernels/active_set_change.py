"""The next set of held contacts after one event, where it is beyond doubt: else nothing is decided
here.

It starts from the set before with the contact that closed, or without the one whose multiplier
vanished. A member whose multiplier is negative leaves: a closed contact that depends on the set
through it takes its place if its own multiplier is then positive; else both open. What still closes
is taken in. The set found is taken if every multiplier is strictly positive and every other closed
contact opens strictly or depends on the set: then it solves the complementarity problem of
velocities, whose velocity is unique (Lawson & Hanson 1974, chapter 23), whatever the way it was
found.
"""

import numpy as np

from nsbench.compilation.decorators import inlined, inner_kernel, one
from nsbench.solvers.event_driven.contacts.kernels import loop_state
from nsbench.solvers.event_driven.contacts.kernels.held_set import (
    build_held_set,
    column,
    gap_rate,
    squared_sine_to_span,
    toggled,
)
from nsbench.solvers.event_driven.contacts.kernels.taylor_flow import (
    copied,
    extend_series,
    gaps,
    size,
    sorted_index,
)

TURNS = 24  # changes of the set after one event: beyond, the full method takes over
UNCLEAR = 1e2  # times the bound on dependence, up and down, in which nothing is decided
AHEAD = 1e-5  # of a step of the integrator: the first look ahead, where slopes must show
# what a contact is: open, leaving, closed and dependent, in the set; + NEW
NOT = 0
OUT = 1
KEPT = 2
HELD = 3
NEW = 4


@inlined
def _weakest(W, gear, listed, norm, small, spared):
    """Index of the member whose multiplier is smallest, if that is not above `small`; -1 if all
    are; -2 if one is no number.

    spared: a member whose multiplier is zero now and grows.
    """
    kind = listed[0]
    sign = listed[4]
    worst = small
    which = -1
    for a in range(W.size):
        lam = (sign[W[a]] if kind[W[a]] > 0 else 1.0) * gear[4][a, 0] * norm[W[a]]
        if not np.isfinite(lam):
            return -2
        if lam <= worst and (W[a] != spared or lam < -small):
            worst = lam
            which = a
    return which


@inner_kernel
def _swap(a, W, gear, role, listed, places, x, dependent):
    """Member a leaves: (clear, the dependent contact that takes its place or -1, their coefficient,
    inverse Gram entry).

    With z the column of the inverse Gram matrix, G_c G^T z is the coefficient of the member in row
    c. If it is negative, c carries what the member would have to pull; if all are positive they
    open with the member and are marked OUT.
    """
    k = W[a]
    pull, top = column(k, W, gear, x.size)
    best = 0.0
    which = -1
    turn = listed[4][k] if listed[0][k] > 0 else 1.0
    for c in range(role.size):
        if role[c] == KEPT or role[c] == KEPT + NEW:
            y, length = gap_rate(c, listed, places, x, pull)
            if y * y > dependent / UNCLEAR * length:
                if y * y < dependent * UNCLEAR * length:
                    return False, -1, 0.0, top
                if turn * y < best:
                    best = turn * y
                    which = c
    if which < 0:
        for c in range(role.size):
            if role[c] == KEPT or role[c] == KEPT + NEW:
                y, length = gap_rate(c, listed, places, x, pull)
                if y * y > dependent * UNCLEAR * length:
                    role[c] += OUT - KEPT
    return True, which, best * np.sqrt(top), top


@inlined
def _closing(role, all_, entry, listed, places, norm, x, v, num):
    """The closed contact outside the set that does not open strictly, and its speed; -1 if there is
    none, -2: unclear.

    entry: one that opens from zero speed, which was looked at before.
    """
    near = num[loop_state.TOL] * (num[loop_state.UNIT] + size(x))
    small = num[loop_state.DOUBT] * num[loop_state.SIZE]
    g = np.empty(role.size)
    gaps(all_, listed, places, x, g)
    for k in range(role.size):
        what = role[k] % NEW
        if what == HELD or k == entry:
            continue
        if what == KEPT:
            if g[k] > near * norm[k]:
                return -2, 0.0
        elif what == OUT or g[k] <= near * norm[k]:
            w, _ = gap_rate(k, listed, places, x, v)
            if not w > small * norm[k]:
                return (-2 if what == OUT else k), w / norm[k]
    return -1, 0.0


@inlined
def _roles(W, kept):
    role = np.zeros(kept.size, np.int64)
    for k in range(kept.size):
        role[k] = KEPT if kept[k] else NOT
    for k in W:
        role[k] = HELD
    return role


@inner_kernel
def _leave(a, W, which, role):
    """The set without member a, with the dependent contact `which` in its place if that is one."""
    k = W[a]
    W = toggled(W, k, -one())
    role[k] += (OUT if which < 0 else KEPT) - HELD
    if which >= 0:
        W = toggled(W, which, one())
        role[which] += HELD - KEPT
    return W


@inlined
def _velocity(W, start, x, listed, places, norm, drift, width, order, X, F, work, num):
    """Gear and velocity (X[1], mu of order 0) with the set W; False if its rows depend on each
    other."""
    copied(start, x)
    good, gear = build_held_set(
        W, listed, places, norm, x, width, order, work, num[loop_state.UNIT]
    )
    if good:
        copied(x, X[0])
        extend_series(one() - 1, one(), W, gear, listed, drift, X, F)
        num[loop_state.SIZE] = max(num[loop_state.SIZE], size(F[0]))
    return good, gear


@inlined
def _first(entry, closing, slope, W, gear, role, listed, places, norm, x, num, pace):
    """The first set to try: (clear, set, member whose multiplier grows from zero, contact that
    opens from rest)."""
    if closing:
        role[entry] = HELD + NEW
        return True, toggled(W, entry, one()), -1, -1
    a = sorted_index(W, entry)
    clear, which, c, top = _swap(a, W, gear, role, listed, places, x, num[loop_state.DEPENDENT])
    sight = UNCLEAR * num[loop_state.STRICT] * num[loop_state.SIZE]
    W = _leave(a, W, which, role)
    if which >= 0:
        return clear and slope / c * norm[which] * AHEAD * pace > sight, W, which, -1
    for k in range(role.size):
        if role[k] == OUT and k != entry:  # opens from rest with it: too many to follow here
            clear = False
    return clear and -slope / top * AHEAD * pace > sight, W, -1, entry


@inlined
def next_active_set(
    entry,
    closing,
    slope,
    W,
    gear,
    kept,
    listed,
    places,
    norm,
    drift,
    width,
    order,
    x,
    X,
    F,
    work,
    num,
    pace,
):
    """(sure, set, gear, role): the next set and all for its arc, with mu and X of order 0; x is put
    on it.

    entry: what closed, or vanished with that `slope` of its multiplier, of the set W with its gear;
    kept (m,): closed contacts that are held or depend on those; pace: a step of the integrator;
    role (m,): what every contact is then.
    """
    role = _roles(W, kept)
    start = x.copy()
    small = num[loop_state.DOUBT] * num[loop_state.SIZE]
    sure, W2, spared, rising = _first(
        entry, closing, slope, W, gear, role, listed, places, norm, x, num, pace
    )
    fresh = entry if closing else -1
    all_ = np.empty(kept.size, np.int64)
    for k in range(kept.size):
        all_[k] = k
    for _ in range(TURNS):
        if not sure:
            break
        sure, gear2 = _velocity(
            W2, start, x, listed, places, norm, drift, width, order, X, F, work, num
        )
        if not sure:
            break
        if fresh >= 0:  # what was taken in last must be independent of the others
            _, top = column(fresh, W2, gear2, x.size)
            _, length = gap_rate(fresh, listed, places, x, X[1])
            sure = 1.0 > UNCLEAR * num[loop_state.DEPENDENT] * top * length
            fresh = -1
        a = _weakest(W2, gear2, listed, norm, small, spared)
        if a >= 0 and sure:
            sure, which, _, _ = _swap(
                a, W2, gear2, role, listed, places, x, num[loop_state.DEPENDENT]
            )
            sure &= not (closing and W2[a] == entry)
            W2 = _leave(a, W2, which, role)
            continue
        k, w = _closing(role, all_, rising, listed, places, norm, x, X[1], num)
        if a == -1 and k == -1 and sure:
            return True, W2, gear2, role
        sure &= a == -1 and k >= 0
        if sure and w < -small:
            W2 = toggled(W2, k, one())
            role[k] = HELD + NEW
            fresh = k
        elif sure:
            sure = (
                squared_sine_to_span(k, W2, gear2, listed, places, x)
                < num[loop_state.DEPENDENT] / UNCLEAR
            )
            role[k] = KEPT + NEW
    return False, W, gear, role
