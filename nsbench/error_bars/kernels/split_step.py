"""Steps of the split error bound: a known vector by the linearised flow, and radii of the rest.

See nsbench.error_bars.split_bound. B (R, n): orthonormal bases of the spans of the groups, one
after the other; part k of the split, from 1 on, has the rows ptr[k - 1] to ptr[k] of B, part 0 what
is orthogonal to all of them.
"""

from typing import NamedTuple

import numpy as np

from nsbench.compilation.borrowed_arrays import borrowed
from nsbench.compilation.decorators import inner_kernel, njit, summing_kernel
from nsbench.error_bars.kernels.cubic import (
    BEYOND_SIMPSON,
    BOOLE,
    fill_moved,
    fill_scaled,
    fill_weighted,
    norm,
    upper_mean,
)
from nsbench.error_bars.kernels.local_piece import OUTSIDE

TERMS = 19  # of exp(A) v for |A| <= 1
SMALL = 2.0**-56  # of v: terms below are rounding
LONG = 8.0  # of the exponent of a flow: by scaling and squaring, no longer by its series
# of the error: a second solution is worth it where more than UNKNOWN of it has no known direction,
# and WIDENED of it is new
UNKNOWN = 0.02
WIDENED = 1e-3
LEAST = OUTSIDE  # of own length: not even the states of S are known any better
MOMENT = np.array([-0.1, -0.25, 0.0, 0.25, 0.1])  # at the quarters: more than the first moment


class SplitArrays(NamedTuple):
    """A split, and how the drift acts on its parts (P,).

    along (n, n): A = P J P of the tangential part, speed: |A|. rates: one-sided Lipschitz constants
    in the parts; inflows: norms of the drift's derivative into them from the rest. J (n, n),
    change, one_sided, two_sided: of the drift, as in growth.Linear. is_in (m,): is a constraint one
    of the contacts? sizes (P, m): of all unit gradients in the parts.
    """

    B: np.ndarray
    ptr: np.ndarray
    is_empty: np.ndarray
    along: np.ndarray
    speed: float
    rates: np.ndarray
    inflows: np.ndarray
    J: np.ndarray
    change: float
    one_sided: float
    two_sided: float
    is_in: np.ndarray
    sizes: np.ndarray


class Faces(NamedTuple):
    """Unit gradients N (m, n) of all constraints. has_two (m,): is it a link in one dimension,
    which has two ends, on either of which the motion may be?"""

    N: np.ndarray
    has_two: np.ndarray


class Stretches(NamedTuple):
    """K stretches of the curve, from one to the next.

    H (K,): their lengths. rho (K, 5, n): residuals at the quarters, or (K, 0, n) none; slack (K,):
    bounds of what they do not hold. gaps (K, m): the least of all constraints; pulls (K, P, 4):
    kappa of the parts in the quarters. growth, added (K,): the norm e of an error is at most
    growth e + added at the end.
    """

    H: np.ndarray
    rho: np.ndarray
    slack: np.ndarray
    gaps: np.ndarray
    pulls: np.ndarray
    growth: np.ndarray
    added: np.ndarray


class ErrorArrays(NamedTuple):
    """The error at the ends of K stretches: delta (K + 1, n), radii (K + 1, P) of the rest, whole
    (K + 1,) of all of it; over each of them the integral (K, n) of J delta, pulled, and unknown
    (K,), a bound of what that lacks. is_reached (m,): constraints that the motion may have reached
    on the last stretch that was tried."""

    delta: np.ndarray
    radii: np.ndarray
    whole: np.ndarray
    pulled: np.ndarray
    unknown: np.ndarray
    is_reached: np.ndarray


class FlowArrays(NamedTuple):
    """The known part on the way: start, end (n,), integral (n,) over it."""

    start: np.ndarray
    end: np.ndarray
    integral: np.ndarray


@summing_kernel
def _dot(a, b):
    s = 0.0
    for c in range(len(a)):
        s += a[c] * b[c]
    return s


@inner_kernel
def _size_in(B, first, last, v):
    """Return the size of v (n,) in the span of the rows first to last of B."""
    s = 0.0
    for r in range(first, last):
        d = _dot(B[r], v)
        s += d * d
    return np.sqrt(s)


@inner_kernel
def _fill_tangential(B, v, out):
    """Fill out (n,) with what of v (n,) is orthogonal to the rows of B."""
    fill_scaled(v, 1.0, out)
    for r in range(len(B)):
        fill_moved(out, -_dot(B[r], v), B[r], out)


@inner_kernel
def _fill_flow(A, H, rate, v, end, mean):
    """Fill end (n,) with exp(H A) v, and mean (n,) with that of exp(s A) v over 0 <= s <= H; rate:
    of H |A|, or more.

    Taylor series, over as many parts as the rate is large.
    """
    parts = 1
    while rate > parts:
        parts *= 2
    terms = 0
    rest = 1.0
    while rest > SMALL and terms < TERMS:
        terms += 1
        rest *= rate / parts / terms
    term = np.empty(len(v))
    next_term = np.empty(len(v))
    fill_scaled(v, 1.0, end)
    mean[:] = 0.0
    for _ in range(parts):
        fill_scaled(end, 1.0, term)
        end[:] = 0.0
        for k in range(max(terms, 1)):
            fill_moved(end, 1.0, term, end)
            fill_moved(mean, 1.0 / ((k + 1) * parts), term, mean)
            for c in range(len(v)):
                next_term[c] = _dot(A[c], term) * H / parts / (k + 1)
            fill_scaled(next_term, 1.0, term)


@inner_kernel
def _residual_in(B, first, last, rho, H):
    """Return an upper estimate of the integral of the size, in the span of the rows first to last
    of B, of rho (5, n) at the quarters."""
    sizes = np.empty(len(rho))
    for e in range(len(rho)):
        sizes[e] = _size_in(B, first, last, rho[e])
    return H * upper_mean(sizes)


@inner_kernel
def _residual_size(rho, H):
    """Return an upper estimate of the integral of |rho|, from rho (5, n) at the quarters, or of
    none: rho (0, n)."""
    sizes = np.empty(len(rho))
    for e in range(len(rho)):
        sizes[e] = norm(rho[e])
    return H * upper_mean(sizes)


@inner_kernel
def _carry_known(split, rho, H, rate, flow):
    """Add to the flow what the residuals rho (5, n) do, from the middle of the interval; return how
    far the known part may be from the line between its ends, and bounds of what the formulas of
    end and integral leave out."""
    whole = 0.0
    error = 0.0
    lack = 0.0
    if len(rho) > 0:
        n = len(flow.end)
        at = np.empty(rho.shape)
        for e in range(len(rho)):
            _fill_tangential(split.B, rho[e], at[e])
        whole = _residual_size(at, H)
        total = np.empty(n)
        fill_weighted(BEYOND_SIMPSON, at, total)
        rough = H * norm(total)
        # the first moment of rho about the middle, which the formulas leave out, by Boole's rule is
        # 0.089 (at[3] - at[1]) + 0.039 (at[4] - at[0]) times H
        fill_weighted(MOMENT, at, total)
        moment = H * norm(total)
        fill_weighted(BOOLE, at, total)
        fill_scaled(total, H, total)
        fill_moved(flow.end, 1.0, total, flow.end)
        for c in range(n):
            flow.end[c] += 0.5 * H * _dot(split.along[c], total)
        fill_moved(flow.integral, 0.5 * H, total, flow.integral)
        second = max(rate * rate, np.expm1(rate) - rate)  # of the exponential series
        error = rough + second * whole + rate * moment
        lack = H * (0.5 * rough + moment + max(rate, second) * whole)
    bend = np.exp(rate) * (whole + 0.125 * rate * rate * norm(flow.start))
    return bend, error, lack


@inner_kernel
def _held(r, rate, inflow, pulls, H):
    """Return a bound at H of a size that is r at 0 and grows by rate times itself and inflow; less
    pulls (4,) in the quarters of H, as long as it is positive."""
    step = H / len(pulls)
    grown = np.exp(rate * step)
    for pull in pulls:
        net = inflow - pull
        factor = max(1.0, grown) if net > 0.0 else min(1.0, grown)
        r = max(0.0, grown * r + step * net * factor)
    return r


@inner_kernel
def _carry(split, delta, size, rho, slack, H, pulls, is_given, flow, radii, peaks):
    """Carry an error over a stretch of length H: delta (n,), and radii (P,) of the rest, in and
    out; peaks (P,): filled with the largest on the way.

    size: of the error, at most. flow: filled; is_given: does its end hold exp(H A) P delta and its
    integral that of exp(s A) P delta already? Returns how far the known part may be from the line
    between its ends, what its integral lacks, and the largest size of the error.
    """
    rate = H * split.speed
    _fill_tangential(split.B, delta, flow.start)
    if not is_given:
        _fill_flow(split.along, H, rate, flow.start, flow.end, flow.integral)
        fill_scaled(flow.integral, H, flow.integral)
    bend, error, lack = _carry_known(split, rho, H, rate, flow)
    most = max(1.0, np.exp(split.one_sided * H)) * (size + _residual_size(rho, H) + slack)
    peaks[:] = 0.0
    # the groups first: what they hold flows into the tangential part, which comes last
    for k in range(len(radii) - 1, -1, -1):
        first = radii[k]
        rest = norm(peaks)
        added = slack + error
        if k > 0:
            rows = split.ptr[k - 1], split.ptr[k]
            first += _size_in(split.B, rows[0], rows[1], delta)
            rest = most
            added = slack + _residual_in(split.B, rows[0], rows[1], rho, H)
        inflow = split.inflows[k] * rest + split.change * most
        grown = max(1.0, np.exp(split.rates[k] * H))
        peaks[k] = 0.0 if split.is_empty[k] else grown * (first + H * inflow + added)
        radii[k] = _held(first, split.rates[k], inflow, pulls[k], H) + grown * added
        if split.is_empty[k]:
            radii[k] = 0.0
    return bend, lack, most


@inner_kernel
def _reaches_more(split, faces, flow, bend, peaks, gaps, is_reached):
    """Fill is_reached (m,): may the error bridge the gaps (m,) on the stretch? Return whether it
    does one of a constraint that is none of the contacts."""
    more = False
    for r in range(len(gaps)):
        first = _dot(faces.N[r], flow.start)
        last = _dot(faces.N[r], flow.end)
        reach = max(first, last)
        if faces.has_two[r]:
            reach = max(reach, -first, -last)
        reach += bend
        for k in range(len(peaks)):
            reach += peaks[k] * split.sizes[k, r]
        is_reached[r] = gaps[r] <= reach
        more |= is_reached[r] and not split.is_in[r]
    return more


@inner_kernel
def _is_widened(new, size, grown):
    """Has the radius of what is not known grown to `new` by more than a second solution costs?
    size: of the error; grown: the radius if it had grown as the distance of two motions."""
    return new > max(UNKNOWN * size, LEAST) and new - grown > WIDENED * size


@njit(cache=True, error_model="numpy")
def carry_split(
    split: SplitArrays,
    faces: Faces,
    on: Stretches,
    first: int,
    most: int,
    is_one: bool,
    size: float,
    radius: float,
    is_given: bool,
    flow: FlowArrays,
    out: ErrorArrays,
) -> int:
    """Carry the error at the head of `out` over stretches of the curve, from the first on, `most`
    of them.

    size, radius: of the error and of its rest, at most, in the parts of whatever split they are
    known. It ends before a stretch on which other contacts may act, the flow is a long one, a
    second solution may be of use, or the norm alone is the better bound; is_one: it is carried over
    the first one in any case. flow: room; is_given: see _carry, of one. Returns over how many.
    """
    split = borrowed(split)
    faces = borrowed(faces)
    on = borrowed(on)
    flow = borrowed(flow)
    out = borrowed(out)
    peaks = np.empty(len(split.rates))
    for at in range(most):
        k = first + at
        H = on.H[k]
        if not (is_one or H * split.speed <= LONG):
            return at
        radii = out.radii[at + 1]
        fill_scaled(out.radii[at], 1.0, radii)
        error = out.delta[at], size, on.rho[k], on.slack[k], H, on.pulls[k]
        bend, lack, largest = _carry(split, *error, is_given, flow, radii, peaks)
        more = _reaches_more(split, faces, flow, bend, peaks, on.gaps[k], out.is_reached)
        new = norm(radii)
        whole = norm(flow.end) + new
        bound = on.growth[k] * out.whole[at] + on.added[k]
        is_better = bound < new
        widened = _is_widened(new, whole, max(1.0, on.growth[k]) * radius)
        if not is_one and (more or is_better or widened):
            return at
        fill_scaled(flow.end, 1.0, out.delta[at + 1])
        out.whole[at + 1] = min(bound, whole)
        for c in range(len(flow.end)):
            out.pulled[at, c] = _dot(split.J[c], flow.integral)
        out.unknown[at] = split.two_sided * (norm(peaks) * H + lack) + H * split.change * largest
        size = whole
        radius = new
    return most
