"""The event-driven loop for drifts f = A x + c and constraints that stand still, as machine code.

Arcs are Taylor series (see series), events are isolated descents of polynomials (see sightings). After an event the next
set of held contacts is chosen here if it is beyond doubt: every multiplier strictly positive, every other closed contact
strictly opening, or dependent as before. All else is left to the caller, who solves the complementarity problem with
look-ahead and comes back. What fails here is left to the caller too.
"""
import numpy as np
from numba import njit

from nsbench.kernels.series import at, extend, gap, hold, longest
from nsbench.kernels.sightings import first_event, strays, travel
from nsbench.kernels.skyline import arrange, solve

DONE, CHOOSE, RELIST, FAIL, PAUSE = 0, 1, 2, 3, 4
T, END, TOL, EPS, SIZE, MAX_STEP, BOX, REACH, H, DOUBT, STRICT, DEPENDENT, NUM = range(13)     # entries of `num`
SAMPLE, STEPS, EVENTS, COLUMNS, FIRED, TOUCHES, ARCS, SOLVED, PEAK, ORDERS, MAX_STEPS, PACES, CNT = range(13)  # of `cnt`
SHORT = 8               # terms of a series where the next event is expected soon
LEAST = 1e-12           # pivots over their diagonal that count as zero: contacts that lock or depend on each other
DEFECT = 1e3            # local errors, of the equation at the end of a step: the slope of a series has lost an order
TOO_MANY = 50_000       # steps still to come: the equation is stiff, another method is meant for it


@njit(cache=True, error_model="numpy")
def outfit(W, listed, places, norm, x, width, order, work):
    """Everything an arc with the held entries W needs, with x put on them; and whether that could be done."""
    p = W.size
    C, V, count = np.zeros((p, width), np.int64), np.zeros((p, width)), np.zeros(p, np.int64)
    U, mu = np.zeros((p, 3, order + 2)), np.zeros((p, order + 1))
    kind, first, _, _, _, dim = listed
    second, ptr, cols = listed[2], places[1], places[2]
    for a in range(p):                                    # the pattern alone, for the plan
        k = W[a]
        if kind[k] == 0:
            for e in range(ptr[first[k]], ptr[first[k] + 1]):
                C[a, count[a]] = cols[e]
                count[a] += 1
        else:
            for c in range(dim[k]):
                C[a, c] = first[k] + c
                if kind[k] == 1:
                    C[a, dim[k] + c] = second[k] + c
            count[a] = 2 * dim[k] if kind[k] == 1 else dim[k]
    plan = arrange(C, count, p, x.size)
    E = np.empty(plan[2][p])
    good = hold(W, plan, listed, places, norm, x, C, V, count, U, E, work, LEAST)
    return good, (C, V, count, U, mu, plan, E)


@njit(cache=True, error_model="numpy")
def _speed(k, listed, places, x, v):
    """(G_k v, |G_k|^2) of entry k."""
    kind, p, q, d, sign, dim = listed
    anchors, ptr, cols, vals, _ = places
    s, size = 0.0, 0.0
    if kind[k] == 0:
        for e in range(ptr[p[k]], ptr[p[k] + 1]):
            s += vals[e] * v[cols[e]]
            size += vals[e] * vals[e]
        return s, size
    for c in range(dim[k]):
        u = (x[p[k] + c] - (x[q[k] + c] if kind[k] == 1 else anchors[q[k] + c])) / d[k]
        s += u * (v[p[k] + c] - (v[q[k] + c] if kind[k] == 1 else 0.0))
        size += u * u
    return sign[k] * s, size * (2.0 if kind[k] == 1 else 1.0)


@njit(cache=True, error_model="numpy")
def combine(gear, W, z, n):
    """G^T z."""
    C, V, count = gear[0], gear[1], gear[2]
    out = np.zeros(n)
    for a in range(W.size):
        for e in range(count[a]):
            out[C[a, e]] += z[a] * V[a, e]
    return out


@njit(cache=True, error_model="numpy")
def certain(entry, closing, pull, slope, W, gear, kept, listed, places, norm, x, v, num, pace):
    """Whether holding W from now on is beyond doubt; gear: of W, with mu[:, 0]; v: the velocity.

    entry: what closed, or vanished with that `slope` of its multiplier; pull: G^T z with the old set, z the column of the
    inverse of its Gram matrix, divided by the root of its diagonal entry: what depends on `entry` does not meet it.
    """
    kind, sign, n = listed[0], listed[4], x.size
    small = num[DOUBT] * num[SIZE]
    if not np.isfinite(small):
        return False
    held = np.zeros(kind.size, np.bool_)
    for a in range(W.size):
        k = W[a]
        held[k] = True
        if not (sign[k] if kind[k] > 0 else 1.0) * gear[4][a, 0] * norm[k] > small:
            return False
    near = num[TOL] * (1.0 + np.abs(x).max())
    for k in range(kind.size):
        if held[k] or not (kept[k] or gap(k, listed, places, x) <= near * norm[k]):
            continue
        if kept[k] and k != entry:
            if gap(k, listed, places, x) > near * norm[k]:
                return False
            if not closing:
                y, size = _speed(k, listed, places, x, pull)
                if y * y > 1e-2 * num[DEPENDENT] * size:
                    return False
        elif k == entry:
            if not (not closing and -slope * 1e-5 * pace > 1e2 * num[STRICT] * num[SIZE]):
                return False
        else:
            w, _ = _speed(k, listed, places, x, v)
            if not w > small * norm[k]:
                return False
    return True


@njit(cache=True, error_model="numpy")
def _column(entry, W, gear, n):
    """G^T z / sqrt(z_k) and z_k for the column z = M^-1 e_k of `entry`."""
    z, k = np.zeros(W.size), np.searchsorted(W, entry)
    z[k] = 1.0
    solve(gear[5], W.size, gear[6], z, z)
    top = z[k]
    for a in range(W.size):
        z[a] /= np.sqrt(top)
    return combine(gear, W, z, n), top


@njit(cache=True, error_model="numpy")
def _switched(W, entry, closing):
    """W with the entry put in or taken out; sorted."""
    at_ = np.searchsorted(W, entry)
    out = np.empty(W.size + (1 if closing else -1), np.int64)
    out[:at_] = W[:at_]
    if closing:
        out[at_] = entry
        out[at_ + 1:] = W[at_:]
    else:
        out[at_:] = W[at_ + 1:]
    return out


@njit(cache=True, error_model="numpy")
def _path(s, deg, X, F, out, push):
    """The state and the reaction since the start of the step at s."""
    at(X, deg, s, out)
    for i in range(out.size):
        total = 0.0
        for j in range(deg - 1, -1, -1):
            total = total * s + F[j, i] / (j + 1)
        push[i] = out[i] - X[0, i] - total * s


@njit(cache=True, error_model="numpy")
def _rate(s, deg, X, out):
    """out: the slope of the series at s."""
    out[:] = deg * X[deg]
    for j in range(deg - 1, 0, -1):
        for i in range(out.size):
            out[i] = out[i] * s + j * X[j, i]


@njit(cache=True, error_model="numpy")
def _impulse(a, s, deg, mu):
    total = 0.0
    for j in range(deg - 1, -1, -1):
        total = total * s + mu[a, j] / (j + 1)
    return total * s


@njit(cache=True, error_model="numpy")
def _advance(s, t, deg, W, gear, listed, X, F, x, samples, records, book, cnt):
    """Write the samples up to t, at s from the start of the step, and move x, reaction and impulses there."""
    XS, RS, ZS = records
    column, total, reaction = book
    kind, sign, mu = listed[0], listed[4], gear[4]
    push, t0 = np.empty(x.size), t - s
    while cnt[SAMPLE] < samples.size and samples[cnt[SAMPLE]] <= t:
        r = cnt[SAMPLE]
        u = min(samples[r] - t0, s)
        _path(u, deg, X, F, XS[r], push)
        for i in range(x.size):
            RS[r, i] = reaction[i] + push[i]
        for c in range(cnt[COLUMNS]):
            ZS[r, c] = total[c]
        for a in range(W.size):
            k = W[a]
            ZS[r, column[k]] += (sign[k] if kind[k] > 0 else 1.0) * _impulse(a, u, deg, mu)
        cnt[SAMPLE] += 1
    _path(s, deg, X, F, x, push)
    for i in range(x.size):
        reaction[i] += push[i]
    for a in range(W.size):
        k = W[a]
        total[column[k]] += (sign[k] if kind[k] > 0 else 1.0) * _impulse(a, s, deg, mu)


@njit(cache=True, error_model="numpy")
def _length(deg, W, gear, X, x, origin, reach, hard, num):
    """(h, code): the step that the series of this degree allows, and whether the list must be made anew first."""
    h = min(longest(X, gear[4], deg, num[EPS], W), num[MAX_STEP], num[END] - num[T])
    if not h > 4e-16 * (abs(num[T]) + abs(num[END])) and h < num[END] - num[T]:
        return h, FAIL
    for _ in range(60):
        travel(X, deg, h, reach)
        if num[REACH] == np.inf:
            return h, DONE
        may, did = strays(x, origin, reach, hard, 0.5 * num[REACH])
        if not may:
            return h, DONE
        if did:
            return h, RELIST
        h *= 0.5
    return h, FAIL


@njit(cache=True, error_model="numpy")
def _watch(W, gear, basis, listed, places, norm, x, num):
    """Bands, levels and arms of gaps and multipliers at the start of an arc (see solvers._crossings)."""
    m, near = norm.size, num[TOL] * (1.0 + np.abs(x).max())
    band, level, armed = np.empty(m), np.empty(m), np.empty(m, np.bool_)
    for k in range(m):
        band[k] = near * norm[k]
        g = 0.0 if basis[k] else gap(k, listed, places, x)
        armed[k] = g > band[k]
        level[k] = 0.0 if armed[k] else min(g, 0.0) - band[k]
    firm, low = np.empty(W.size, np.bool_), np.empty(W.size)
    for a in range(W.size):
        lam = gear[4][a, 0] * (listed[4][W[a]] if listed[0][W[a]] > 0 else 1.0)
        tight = num[TOL] * num[SIZE] / norm[W[a]]
        firm[a] = lam > tight
        low[a] = min(lam, 0.0) - tight
    return band, level, armed, firm, low


@njit(cache=True, error_model="numpy")
def _look(deg, h, W, gear, basis, listed, places, norm, X, watch, reach, num):
    band, level, armed, firm, low = watch
    return first_event(W, basis, listed, places, norm, X, gear[4], deg, h, band, level, armed, firm, low,
                       num[TOL] * num[SIZE], reach)


@njit(cache=True, error_model="numpy")
def _columns(W, column, cnt):
    for k in W:
        if column[k] < 0:
            column[k] = cnt[COLUMNS]
            cnt[COLUMNS] += 1


@njit(cache=True, error_model="numpy")
def _note(entry, closing, log, paces, num, cnt):
    log[0][cnt[EVENTS]] = num[T]
    log[1][cnt[EVENTS]] = 0 if closing else 1
    log[2][cnt[EVENTS]] = entry
    cnt[EVENTS] += 1
    cnt[SOLVED] += 1


@njit(cache=True, error_model="numpy")
def walk(listed, places, norm, drift, hard, width, order, x, origin, basis, kept, samples, records, book, paces, log, num, cnt):
    """Go on from num[T] with the basis until something must be decided elsewhere; returns the code of what.

    listed, places, norm: the list of constraints; hard (f, 3): start, count, dim of hard particles, listed around
    `origin`; basis, kept (m,) masks; the rest is work in progress: x, records and book, paces, log, num, cnt.
    """
    n = x.size
    X, F, V, reach, work = np.empty((order + 1, n)), np.empty((order, n)), np.empty(n), np.empty(n), np.zeros(n)
    W = np.flatnonzero(basis)
    good, gear = outfit(W, listed, places, norm, x, width, order, work)
    ready, quick = 0, SHORT
    while good:
        rhs, arc_h = np.empty(W.size), 0.0
        _columns(W, book[0], cnt)
        if ready == 0:
            X[0] = x
            extend(0, 1, W, gear[5], gear[6], listed, drift, gear[0], gear[1], gear[2], gear[3], gear[4], X, F, rhs)
        watch = _watch(W, gear, basis, listed, places, norm, x, num)
        ready, deg, entry = 1, 1, -1
        while entry < 0:
            if cnt[STEPS] >= cnt[MAX_STEPS] or not np.abs(x).max() <= num[BOX]:
                return FAIL
            for goal in (quick, order):
                if goal <= deg:
                    continue
                extend(deg, goal, W, gear[5], gear[6], listed, drift, gear[0], gear[1], gear[2], gear[3], gear[4], X, F, rhs)
                cnt[ORDERS] += goal - deg
                deg = goal
                h, code = _length(deg, W, gear, X, x, origin, reach, hard, num)
                if code != DONE:
                    return code
                s, entry, touches = _look(deg, h, W, gear, basis, listed, places, norm, X, watch, reach, num)
                if entry >= 0 or h >= num[END] - num[T]:
                    break
            cnt[STEPS] += 1
            cnt[TOUCHES] += touches
            num[H], arc_h = max(num[H], h), max(arc_h, h)
            if entry < 0 and (num[END] - num[T]) > TOO_MANY * h:
                return FAIL
            quick = order if entry < 0 else SHORT
            last = entry < 0 and h >= num[END] - num[T]
            s = h if entry < 0 else s * h
            num[T] = num[END] if last else num[T] + s
            _advance(s, num[T], deg, W, gear, listed, X, F, x, samples, records, book, cnt)
            if last:
                return DONE
            if entry < 0:
                _rate(s, deg, X, V)
                if not hold(W, gear[5], listed, places, norm, x, gear[0], gear[1], gear[2], gear[3], gear[6], work, LEAST):
                    return FAIL
                X[0] = x
                extend(0, 1, W, gear[5], gear[6], listed, drift, gear[0], gear[1], gear[2], gear[3], gear[4], X, F, rhs)
                deg = 1
                if not h * np.abs(V - X[1]).max() <= num[EPS] * DEFECT * (1.0 + np.abs(x).max()) + 1e-10 * h * np.abs(V).max():
                    return FAIL                           # the series did not see what the path does
        paces[cnt[PACES] % paces.size] = arc_h
        cnt[PACES] += 1
        cnt[ARCS] += 1
        closing, slope, top, pull = not basis[entry], 0.0, 1.0, V
        cnt[FIRED] = entry if closing else -1
        if not closing:
            pull, top = _column(entry, W, gear, n)
            a = np.searchsorted(W, entry)
            for j in range(deg - 1, 0, -1):
                slope = slope * s + j * gear[4][a, j]
            slope *= (listed[4][entry] if listed[0][entry] > 0 else 1.0) / top
        if closing and kept[entry]:
            return CHOOSE
        W2, y = _switched(W, entry, closing), x.copy()
        good, gear2 = outfit(W2, listed, places, norm, y, width, order, work)
        if not good:
            return CHOOSE
        X[0] = y
        rhs = np.empty(W2.size)
        extend(0, 1, W2, gear2[5], gear2[6], listed, drift, gear2[0], gear2[1], gear2[2], gear2[3], gear2[4], X, F, rhs)
        num[SIZE] = max(num[SIZE], np.abs(F[0]).max())
        if closing:
            _, top = _column(entry, W2, gear2, n)
            _, size = _speed(entry, listed, places, y, V)
            if not 1.0 > 10.0 * num[DEPENDENT] * top * size:
                return CHOOSE
        if not certain(entry, closing, pull, slope, W2, gear2, kept, listed, places, norm, y, X[1], num, paces.max()):
            return CHOOSE
        W, gear, ready = W2, gear2, 1
        x[:] = y
        basis[entry], kept[entry] = closing, closing
        cnt[PEAK] = max(cnt[PEAK], kept.sum())
        _note(entry, closing, log, paces, num, cnt)
        if cnt[EVENTS] == log[0].size:
            return PAUSE
    return FAIL
