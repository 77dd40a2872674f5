"""The event-driven loop for drifts f = A x + c and constraints that stand still, as machine code.

Arcs are Taylor series (see series), events are isolated descents of polynomials (see sightings).
The next set of held contacts is chosen here if it is beyond doubt (see choice); if not, the caller
solves the complementarity problem with look-ahead and comes back. What fails here is left to the
caller too.
"""

import numpy as np

from nsbench.compilation.decorators import inlined, inner_kernel, njit, one
from nsbench.solvers.event_driven.contacts.kernels import loop_state
from nsbench.solvers.event_driven.contacts.kernels.active_set_change import (
    HELD,
    KEPT,
    NEW,
    next_active_set,
)
from nsbench.solvers.event_driven.contacts.kernels.first_event import (
    displacement_bound,
    first_event,
    leaves_list_certificate,
)
from nsbench.solvers.event_driven.contacts.kernels.held_set import LEAST, build_held_set
from nsbench.solvers.event_driven.contacts.kernels.taylor_flow import (
    apart,
    at,
    copied,
    extend_series,
    gaps,
    project_and_factor,
    size,
    sorted_index,
    step_length,
)

SHORT = 10  # terms of a series where the next event is expected soon
# local errors, of the equation at the end of a step: the slope of a series has lost an order
DEFECT = 1e3
ROUNDED = 1e-10  # of the slope: what ill-conditioned contacts lose by rounding
TOO_MANY = 50_000  # steps still to come: the equation is stiff, another method is meant for it


@inner_kernel
def _path(s, deg, X, F, out, push):
    """The state and the reaction since the start of the step at s."""
    at(X, deg, s, out)
    for i in range(out.size):
        total = 0.0
        for j in range(deg - 1, -1, -1):
            total = total * s + F[j, i] / (j + 1)
        push[i] = out[i] - X[0, i] - total * s


@inner_kernel
def _rate(s, deg, X, out):
    """out: the slope of the series at s."""
    for i in range(out.size):
        out[i] = deg * X[deg, i]
    for j in range(deg - 1, 0, -1):
        for i in range(out.size):
            out[i] = out[i] * s + j * X[j, i]


@inner_kernel
def _impulse(a, s, deg, mu):
    total = 0.0
    for j in range(deg - 1, -1, -1):
        total = total * s + mu[a, j] / (j + 1)
    return total * s


@inlined
def _advance(s, t, deg, W, gear, listed, X, F, x, samples, records, book, cnt):
    """Write the samples up to t, at s from the start of the step, and move x, reaction and impulses
    there."""
    XS, RS, ZS = records
    column, total, reaction = book
    kind = listed[0]
    sign = listed[4]
    mu = gear[4]
    push = np.empty(x.size)
    t0 = t - s
    while cnt[loop_state.SAMPLE] < samples.size and samples[cnt[loop_state.SAMPLE]] <= t:
        r = cnt[loop_state.SAMPLE]
        u = min(samples[r] - t0, s)
        _path(u, deg, X, F, XS[r], push)
        for i in range(x.size):
            RS[r, i] = reaction[i] + push[i]
        for c in range(cnt[loop_state.COLUMNS]):
            ZS[r, c] = total[c]
        for a in range(W.size):
            k = W[a]
            ZS[r, column[k]] += (sign[k] if kind[k] > 0 else 1.0) * _impulse(a, u, deg, mu)
        cnt[loop_state.SAMPLE] += 1
    _path(s, deg, X, F, x, push)
    for i in range(x.size):
        reaction[i] += push[i]
    for a in range(W.size):
        k = W[a]
        total[column[k]] += (sign[k] if kind[k] > 0 else 1.0) * _impulse(a, s, deg, mu)


@inlined
def _length(deg, W, gear, X, x, origin, reach, hard, num):
    """(h, code): the step that the series of this degree allows, and whether the list must be made
    anew first."""
    h = min(
        min(step_length(X, gear[4], deg, num[loop_state.EPS], W), num[loop_state.MAX_STEP]),
        num[loop_state.END] - num[loop_state.T],
    )
    if (
        not h > 4e-16 * (abs(num[loop_state.T]) + abs(num[loop_state.END]))
        and h < num[loop_state.END] - num[loop_state.T]
    ):
        return h, loop_state.FAIL
    for _ in range(60):
        displacement_bound(X, deg, h, one(), reach)
        if num[loop_state.REACH] == np.inf:
            return h, loop_state.DONE
        may, did = leaves_list_certificate(x, origin, reach, hard, 0.5 * num[loop_state.REACH])
        if not may:
            return h, loop_state.DONE
        if did:
            return h, loop_state.RELIST
        h *= 0.5
    return h, loop_state.FAIL


@inlined
def _watch(W, gear, basis, listed, places, norm, x, num):
    """Bands, levels and arms of gaps and multipliers at the start of an arc (see
    solvers._crossings)."""
    m = norm.size
    near = num[loop_state.TOL] * (num[loop_state.UNIT] + size(x))
    band = np.empty(m)
    level = np.empty(m)
    armed = np.empty(m, np.bool_)
    g = np.empty(m)
    all_ = np.empty(m, np.int64)
    for k in range(m):
        all_[k] = k
    gaps(all_, listed, places, x, g)
    for k in range(m):
        band[k] = near * norm[k]
        armed[k] = g[k] > band[k]
        level[k] = 0.0 if armed[k] else min(g[k], 0.0) - band[k]
    firm = np.empty(W.size, np.bool_)
    low = np.empty(W.size)
    for a in range(W.size):
        lam = gear[4][a, 0] * (listed[4][W[a]] if listed[0][W[a]] > 0 else 1.0)
        tight = num[loop_state.TOL] * num[loop_state.SIZE] / norm[W[a]]
        firm[a] = lam > tight
        low[a] = min(lam, 0.0) - tight
    return band, level, armed, firm, low


@inlined
def _look(deg, h, W, gear, basis, listed, places, norm, X, watch, reach, num):
    """(s, entry, touches, watch): the first event within h, and the arms at the end of it."""
    band, level, armed, firm, low = watch
    armed = armed.copy()
    firm = firm.copy()
    displacement_bound(X, deg, h, 2 * one(), reach)
    s, entry, touches = first_event(
        W,
        basis,
        listed,
        places,
        norm,
        X,
        gear[4],
        deg,
        h,
        band,
        level,
        armed,
        firm,
        low,
        num[loop_state.TOL] * num[loop_state.SIZE],
        reach,
    )
    return s, entry, touches, (band, level, armed, firm, low)


@inlined
def _columns(W, column, cnt):
    for k in W:
        if column[k] < 0:
            column[k] = cnt[loop_state.COLUMNS]
            cnt[loop_state.COLUMNS] += 1


@inlined
def _note(role, basis, kept, log, num, cnt):
    """Write down what closed, what opened, what handed its load to others; and take it over into
    the masks."""
    first = loop_state.FIRST
    for kind in (loop_state.CLOSED, loop_state.OPENED, loop_state.PIVOT):
        for k in range(role.size):
            what = role[k] % NEW
            new = role[k] >= NEW
            after = what >= KEPT
            if (
                (kind == loop_state.CLOSED and new and after)
                or (kind == loop_state.OPENED and kept[k] and not new and not after)
                or (kind == loop_state.PIVOT and not new and basis[k] and what == KEPT)
            ):
                log[0][cnt[loop_state.EVENTS]] = num[loop_state.T]
                log[1][cnt[loop_state.EVENTS]] = kind + first
                log[2][cnt[loop_state.EVENTS]] = k
                cnt[loop_state.EVENTS] += 1
                first = 0
                if cnt[loop_state.EVENTS] == log[0].size:
                    return False
    for k in range(role.size):
        basis[k] = role[k] % NEW == HELD
        kept[k] = role[k] % NEW >= KEPT
    cnt[loop_state.SOLVED] += 1
    total = 0
    for k in range(role.size):
        total += kept[k]
    cnt[loop_state.PEAK] = max(cnt[loop_state.PEAK], total)
    return True


@njit(cache=True, error_model="numpy")
def integrate_contacts(
    listed,
    places,
    norm,
    drift,
    hard,
    width,
    order,
    x,
    origin,
    basis,
    kept,
    samples,
    records,
    book,
    paces,
    log,
    num,
    cnt,
):
    """Go on from num[slots.T] with the basis until something must be decided elsewhere; returns the
    code of what.

    listed, places, norm: the list of constraints; hard (f, 3): start, count, dim of hard particles,
    listed around `origin`; basis, kept (m,) masks; the rest is work in progress: x, records and
    book, paces, log, num, cnt.
    """
    n = x.size
    X = np.empty((order + 1, n))
    F = np.empty((order, n))
    V = np.empty(n)
    reach = np.empty(n)
    work = np.zeros(n)
    W = np.empty(basis.size, np.int64)
    p = 0
    for k in range(basis.size):
        if basis[k]:
            W[p] = k
            p += 1
    W = W[:p]
    good, gear = build_held_set(
        W, listed, places, norm, x, width, order, work, num[loop_state.UNIT]
    )
    ready = 0
    quick = SHORT
    while good:
        arc_h = 0.0
        _columns(W, book[0], cnt)
        if ready == 0:
            copied(x, X[0])
            extend_series(one() - 1, one(), W, gear, listed, drift, X, F)
        watch = _watch(W, gear, basis, listed, places, norm, x, num)
        ready = 1
        deg = one()
        entry = -one()
        while entry < 0:
            if (
                cnt[loop_state.STEPS] >= cnt[loop_state.MAX_STEPS]
                or not size(x) <= num[loop_state.BOX]
            ):
                return loop_state.FAIL
            for goal in (quick, order):
                if goal <= deg:
                    continue
                extend_series(deg, goal, W, gear, listed, drift, X, F)
                cnt[loop_state.ORDERS] += goal - deg
                deg = goal
                h, code = _length(deg, W, gear, X, x, origin, reach, hard, num)
                if code != loop_state.DONE:
                    return code
                s, entry, touches, later = _look(
                    deg, h, W, gear, basis, listed, places, norm, X, watch, reach, num
                )
                if entry >= 0 or h >= num[loop_state.END] - num[loop_state.T]:
                    break
            cnt[loop_state.STEPS] += 1
            watch = later
            cnt[loop_state.TOUCHES] += touches if entry < 0 else 0
            num[loop_state.H], arc_h = max(num[loop_state.H], h), max(arc_h, h)
            if entry < 0 and (num[loop_state.END] - num[loop_state.T]) > TOO_MANY * h:
                return loop_state.FAIL
            quick = order if entry < 0 else SHORT
            last = entry < 0 and h >= num[loop_state.END] - num[loop_state.T]
            s = h if entry < 0 else s * h
            num[loop_state.T] = num[loop_state.END] if last else num[loop_state.T] + s
            _advance(
                s, num[loop_state.T], deg, W, gear, listed, X, F, x, samples, records, book, cnt
            )
            if last:
                return loop_state.DONE
            if entry < 0:
                _rate(s, deg, X, V)
                if not project_and_factor(
                    W, gear, listed, places, norm, x, work, LEAST, num[loop_state.UNIT]
                ):
                    return loop_state.FAIL
                copied(x, X[0])
                extend_series(one() - 1, one(), W, gear, listed, drift, X, F)
                deg = one()
                off = h * apart(V, X[1])
                if not off <= num[loop_state.EPS] * DEFECT * (1.0 + size(x)) + ROUNDED * h * size(
                    V
                ):
                    return loop_state.FAIL  # the series did not see what the path does
        paces[cnt[loop_state.PACES] % paces.size] = arc_h
        cnt[loop_state.PACES] += 1
        cnt[loop_state.ARCS] += 1
        closing = not basis[entry]
        slope = 0.0
        cnt[loop_state.FIRED] = entry if closing else -1
        cnt[loop_state.ENTRY] = entry
        if not closing:
            a = sorted_index(W, entry)
            for j in range(deg - 1, 0, -1):
                slope = slope * s + j * gear[4][a, j]
            slope *= listed[4][entry] if listed[0][entry] > 0 else 1.0
        copied(x, V)
        sure = not (closing and kept[entry])
        if sure:
            sure, W, gear, role = next_active_set(
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
                size(paces),
            )
        if not sure:
            copied(V, x)
            return loop_state.CHOOSE
        if not _note(role, basis, kept, log, num, cnt):
            return loop_state.FAIL
        if cnt[loop_state.EVENTS] > log[0].size // 2:
            return loop_state.PAUSE
    return loop_state.FAIL
