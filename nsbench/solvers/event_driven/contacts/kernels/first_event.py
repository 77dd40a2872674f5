"""Isolate the first event on a step whose path is a Taylor series: a gap closes or lam vanishes.

Contacts that the path cannot bring to zero within the step are excluded by a bound on the
displacement of each coordinate; of the others the gap is expanded in a polynomial and its first
descent is isolated. On an interval the polynomial is expanded about the middle (Taylor shift),
where the sum of the moduli of its other terms bounds its variation; intervals are bisected until
that decides. Nothing is sampled, so no descent can hide between sampling points.

Coefficients c (deg + 1,) are of powers of s, the time over the step h.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from nsbench.compilation.decorators import inlined, inner_kernel, one
from nsbench.dynamics.contacts.kernels.contact_arrays import ANCHOR, PAIR, ROW

if TYPE_CHECKING:
    from nsbench.dynamics.contacts.kernels.contact_arrays import Contacts, Layout

NARROWEST = 2.0**-44  # half-width of an interval of [0, 1], below which times cannot be told apart
# Slope in touches per step: a function that reaches zero this steeply at the end of a step crosses.
CROSSING_SLOPE = 100.0
ZERO_AT_END = 1e-2  # in touches: zero up to rounding
MAX_INTERVALS = 4000  # bisected per descent: far more than a polynomial with distinct roots needs
TOUCH = 0.05  # part of the band that a dip must exceed to be an event


class EventLevels(NamedTuple):
    """Levels at which gaps and multipliers fire on an arc.

    An armed function fires where it crosses zero downward. Another fires where it falls below its
    level, and is armed once it exceeds its band: a function that starts at zero must not fire on
    rounding. gap_band, gap_level, gap_armed (m,): of the candidates. multiplier_armed,
    multiplier_level (p,): of the active contacts.
    """

    gap_band: np.ndarray
    gap_level: np.ndarray
    gap_armed: np.ndarray
    multiplier_armed: np.ndarray
    multiplier_level: np.ndarray


@inner_kernel
def value(c: np.ndarray, deg: int, s: float) -> float:
    """Evaluate the polynomial c (deg + 1,) at s by Horner's rule."""
    v = c[deg]
    for j in range(deg - 1, -1, -1):
        v = v * s + c[j]
    return v


@inner_kernel
def slope(c: np.ndarray, deg: int, s: float) -> float:
    """Evaluate the derivative of the polynomial c (deg + 1,) at s."""
    v = deg * c[deg]
    for j in range(deg - 1, 0, -1):
        v = v * s + j * c[j]
    return v


@inner_kernel
def root(c: np.ndarray, deg: int, level: float, lo: float, hi: float) -> float:
    """Find a root of c - level in [lo, hi], positive at lo and negative at hi; c (deg + 1,).

    Newton's method, safeguarded by bisection of the bracket.
    """
    s = hi
    # Newton's method; bisection where it leaves the bracket.
    for _ in range(200):
        v = value(c, deg, s) - level
        if v > 0.0:
            lo = s
        elif v < 0.0:
            hi = s
        else:
            return s
        d = slope(c, deg, s)
        new = s - v / d
        if not (lo < new < hi):
            new = 0.5 * (lo + hi)
        if new == s or hi - lo <= 2e-16 * hi:
            return new
        s = new
    return s


@inner_kernel
def _shift(c, deg, mid, b):
    """Fill b (deg + 1,) with the coefficients about mid: repeated synthetic division."""
    for j in range(deg + 1):
        b[j] = c[j]
    for i in range(deg):
        for j in range(deg - 1, i - 1, -1):
            b[j] += mid * b[j + 1]


@inner_kernel
def first_descent(
    c: np.ndarray, deg: int, level: float, lo: float, hi: float, b: np.ndarray
) -> float:
    """Find the smallest s in [lo, hi] with c(s) < level, up to rounding; -1.0 if there is none.

    b (deg + 1,): scratch. Depth-first bisection, left half first: an interval is discarded if its
    enclosure stays above the level, and ends the search if it descends on it monotonically.
    """
    # The moduli of all terms on [0, hi] bound the variation: most functions are excluded here.
    spread = 0.0
    power = 1.0
    for j in range(1, deg + 1):
        power *= hi
        spread += abs(c[j]) * power
    if c[0] - spread >= level:
        return -1.0
    left = np.empty(128)
    right = np.empty(128)
    left[0] = lo
    right[0] = hi
    top = 1
    intervals = 0
    # Depth-first bisection with a stack of intervals, the leftmost on top.
    while top > 0:
        top -= 1
        a = left[top]
        z = right[top]
        intervals += 1
        mid = 0.5 * (a + z)
        r = 0.5 * (z - a)
        _shift(c, deg, mid, b)
        spread = 0.0
        curvature = 0.0
        power = 1.0
        for j in range(1, deg + 1):
            if j > 1:
                curvature += j * abs(b[j]) * power
            power *= r
            spread += abs(b[j]) * power
        if b[0] - spread >= level:
            continue
        if value(c, deg, a) < level:
            return a
        if deg < 1:
            continue
        if abs(b[1]) > curvature or r < NARROWEST or intervals > MAX_INTERVALS:
            if value(c, deg, z) < level:
                return root(c, deg, level, a, z)
            continue
        left[top] = mid
        right[top] = z
        left[top + 1] = a
        right[top + 1] = mid
        top += 2
    return -1.0


@inner_kernel
def next_crossing(
    c: np.ndarray,
    deg: int,
    armed: bool,
    level: float,
    band: float,
    touch: float,
    hi: float,
    b: np.ndarray,
    d: np.ndarray,
) -> tuple[float, bool, bool]:
    """Find the first event of one function on [0, hi].

    An armed function fires where it crosses zero on its way to -touch; another fires where it falls
    below `level`, and is armed once it exceeds `band`. b, d (deg + 1,): scratch.
    Returns (s or -1.0, armed afterwards, touched). touched: it went below zero, but not by `touch`.
    """
    start = 0.0
    if not armed:
        fall = first_descent(c, deg, level, 0.0, hi, b)
        for j in range(deg + 1):
            d[j] = -c[j]
        rise = first_descent(d, deg, -band, 0.0, hi, b)
        if rise < 0.0 or 0.0 <= fall <= rise:
            return fall, False, False
        start = rise
    deep = first_descent(c, deg, -touch, start, hi, b)
    if (
        deep < 0.0
        and hi == 1.0
        and value(c, deg, 1.0) < ZERO_AT_END * touch
        and slope(c, deg, 1.0) < -CROSSING_SLOPE * touch
    ):
        return (root(c, deg, 0.0, start, 1.0) if value(c, deg, 1.0) < 0.0 else 1.0), True, False
    if deep < 0.0:
        return -1.0, True, first_descent(c, deg, -1e-3 * touch, start, hi, b) >= 0.0
    # Rounding may put it at zero at the start of a step: then it may rise before it falls.
    if value(c, deg, start) <= 0.0:
        for j in range(deg + 1):
            d[j] = -c[j]
        rise = first_descent(d, deg, -touch, start, deep, b)
        if rise < 0.0:
            return start, True, False
        start = rise
    return root(c, deg, 0.0, start, deep), True, False


@inner_kernel
def displacement_bound(X: np.ndarray, deg: int, h: float, first: int, out: np.ndarray) -> None:
    """Bound the displacement of each coordinate within h by the terms from order `first` on.

    X (order + 1, n): Taylor coefficients of the state, used up to deg. Fills out (n,).
    """
    # Horner's rule on the moduli of the coefficients.
    for i in range(out.size):
        out[i] = 0.0
    for j in range(deg, first - 1, -1):
        for i in range(out.size):
            out[i] = (out[i] + abs(X[j, i])) * (h if j > first else 1.0)
    for i in range(out.size):
        out[i] *= h**first


@inner_kernel
def leaves_list_certificate(
    x: np.ndarray, list_centre: np.ndarray, bound: np.ndarray, hard: np.ndarray, limit: float
) -> tuple[bool, bool]:
    """Check whether a hard particle may move farther than `limit` from the centre of the list.

    x, list_centre (n,): state now, and where the candidates were listed. bound (n,): displacement
    in this step. hard (families, 3): first coordinate, particles, dimension. limit: a length.
    Returns (may, did): whether one may, whether any has moved.
    """
    may = False
    did = False
    for f in range(hard.shape[0]):
        for i in range(hard[f, 1]):
            s = 0.0
            r = 0.0
            for c in range(hard[f, 2]):
                k = hard[f, 0] + i * hard[f, 2] + c
                s += (x[k] - list_centre[k]) ** 2
                r += bound[k] ** 2
            did |= s > 0.0
            may |= np.sqrt(s) + np.sqrt(r) > limit
    return may, did


@inner_kernel
def _possible_events(is_active, armed, contacts, layout, X, h, bend):
    """List the entries, not active, that may reach zero within h, and those that are not armed.

    The gaps of the others stay above zero along the straight line by more than both ends may bend
    off it; bend (n,): displacement by the terms of order two and higher.
    """
    kind, p, q, d, sign, dim = contacts
    anchors, ptr, cols, vals, b = layout
    out = np.empty(kind.size, np.int64)
    m = 0
    for k in range(kind.size):
        if is_active[k]:
            continue
        if not armed[k]:
            stays_open = False
        elif kind[k] == ROW:
            g = b[p[k]]
            v = 0.0
            r = 0.0
            for e in range(ptr[p[k]], ptr[p[k] + 1]):
                g += vals[e] * X[0, cols[e]]
                v += vals[e] * X[1, cols[e]]
                r += abs(vals[e]) * bend[cols[e]]
            stays_open = min(g, g + v * h) > r
        else:
            s = 0.0
            sv = 0.0
            vv = 0.0
            r = 0.0
            for c in range(dim[k]):
                i = p[k] + c
                j = q[k] + c
                if kind[k] == PAIR:
                    u = X[0, i] - X[0, j]
                    v = (X[1, i] - X[1, j]) * h
                    w = bend[i] + bend[j]
                else:
                    u = X[0, i] - anchors[j]
                    v = X[1, i] * h
                    w = bend[i]
                s += u * u
                sv += u * v
                vv += v * v
                r += w * w
            r = np.sqrt(r)
            if sign[k] < 0.0:
                stays_open = d[k] > r and max(s, s + 2.0 * sv + vv) < (d[k] - r) * (d[k] - r)
            else:
                if sv + vv <= 0.0:
                    s += 2.0 * sv + vv  # nearest at the end
                elif sv < 0.0:
                    s -= sv * sv / vv * (1.0 + 1e-12)
                stays_open = s > (d[k] + r) * (d[k] + r)
        if not stays_open:
            out[m] = k
            m += 1
    return out[:m]


@inner_kernel
def _gap_series(k, contacts, layout, X, deg, powers, diff, out):
    """Expand the value of taylor_flow.evaluate_gaps for entry k in s; out (deg + 1,)."""
    kind, p, q, d, sign, dim = contacts
    anchors, ptr, cols, vals, b = layout
    out[: deg + 1] = 0.0
    if kind[k] == ROW:
        out[0] = b[p[k]]
        for j in range(deg + 1):
            for e in range(ptr[p[k]], ptr[p[k] + 1]):
                out[j] += vals[e] * X[j, cols[e]] * powers[j]
        return
    for c in range(dim[k]):
        for j in range(deg + 1):
            diff[j] = (X[j, p[k] + c] - (X[j, q[k] + c] if kind[k] == PAIR else 0.0)) * powers[j]
        if kind[k] == ANCHOR:
            diff[0] -= anchors[q[k] + c]
        for j in range(deg + 1):
            s = 0.0
            for a in range(j + 1):
                s += diff[a] * diff[j - a]
            out[j] += s
    out[0] -= d[k] * d[k]
    for j in range(deg + 1):
        out[j] *= 0.5 * sign[k] / d[k]


@inlined
def first_event(
    active: np.ndarray,
    is_active: np.ndarray,
    contacts: Contacts,
    layout: Layout,
    norm: np.ndarray,
    X: np.ndarray,
    mu: np.ndarray,
    deg: int,
    h: float,
    levels: EventLevels,
    multiplier_band: float,
    bend: np.ndarray,
) -> tuple[float, int, int]:
    """Find the first event within h, at s h with 0 <= s <= 1.

    levels: EventLevels, whose armed masks become those at the end of the step. multiplier_band:
    times norm of a gradient. bend (n,): displacement by the terms of order two and higher.
    Returns (s, entry, touches); s = 2.0 and entry = -1 if there is none.
    """
    band, level, armed, firm, low = levels
    kind, _, _, _, sign, _ = contacts
    powers = np.empty(deg + 1)
    diff = np.empty(deg + 1)
    b = np.empty(deg + 1)
    c = np.empty(deg + 1)
    e = np.empty(deg + 1)
    powers[0] = 1.0
    for j in range(deg):
        powers[j + 1] = powers[j] * h
    # The interval shrinks to the earliest event so far: later ones need no root.
    best = 2.0
    which = -one()
    touches = 0
    hi = 1.0
    for k in _possible_events(is_active, armed, contacts, layout, X, h, bend):
        _gap_series(k, contacts, layout, X, deg, powers, diff, c)
        s, armed[k], touched = next_crossing(
            c, deg, armed[k], level[k], band[k], TOUCH * band[k], hi, b, e
        )
        touches += touched
        if s >= 0.0 and s < best:
            best = s
            hi = s
            which = k
    for a in range(active.size):
        k = active[a]
        orientation = sign[k] if kind[k] != ROW else 1.0
        for j in range(deg):
            c[j] = orientation * mu[a, j] * powers[j]
        tight = multiplier_band / norm[k]
        s, firm[a], touched = next_crossing(
            c, deg - 1, firm[a], low[a], tight, TOUCH * tight, hi, b, e
        )
        touches += touched
        if s >= 0.0 and s < best:
            best = s
            hi = s
            which = k
    return best, which, touches
