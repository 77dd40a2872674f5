"""One Taylor step of a Filippov mode: its length, the proof that nothing is hidden in it, the first
event on it.

A program of a mode (see nsbench.solvers.event_driven.filippov.tracing) has the outputs F (n), watch
(d + 1), theta. watch[k] > 0 until surface k is met, or, for the surface it slides on, until its
weight is used up: 1 - s there and 1 + s as the last one.

Certificate of a piece: the fields and the watched functions along the polynomial path are enclosed
with their first ORDER derivatives (kernels.enclosure), those of the polynomials that stand for them
too; at NODES the two agree. So they agree in between, up to the bound on interpolation (Davis 1963,
theorem 3.1.1), and nothing narrower than the piece hides in it.
"""

import numpy as np

from nsbench.solvers.event_driven.filippov.kernels.enclosure import ORDER, enclose, path
from nsbench.solvers.event_driven.filippov.kernels.polynomial_root import (
    CHOOSE,
    CLEAR,
    DEGREE,
    FOUND,
    first_fall,
    shifted,
)
from nsbench.solvers.event_driven.filippov.kernels.taylor_series import (
    horner,
    inner,
    point,
    summing,
)

NODES = -np.cos(
    np.pi * np.arange(ORDER) / (ORDER - 1)
)  # of the interpolation behind the certificate
POWERS = NODES ** np.arange(DEGREE + 1)[:, None]
HALF = 1.0 / 2.0 ** (ORDER - 2)  # its bound, from the coefficient of that order
RESOLVED = 1e-10  # bound on interpolation that counts as smooth, relative (as in solvers._pieces)
DEFECT = 100.0  # local errors by which the path may miss the equation at a node
# truncation of the watched functions, relative to what they reach on the step; roots are polished
SHARP = 1e-9


@inner
def length(C, n, p, x, outs, watches, local, most):
    """A step on which the last terms of the state are below local (1 + |x|), those of the integral
    of the weight below local, those of the watched functions below SHARP of their size (Jorba & Zou
    2005, section 3.2).

    C: table of kernels.taylor; 0 if it is not finite."""
    h = most
    for k in range(max(p - 2, 1), p + 1):
        worst = 0.0
        for i in range(n):
            if not np.isfinite(C[i, k]):
                return 0.0
            worst = max(worst, abs(C[i, k]) / (1.0 + abs(x[i])))
        if worst > 0.0:
            h = min(h, (local / worst) ** (1.0 / k))
        weight = abs(C[outs[n + watches], k]) / (k + 1)
        if weight > 0.0:
            h = min(h, (local / weight) ** (1.0 / (k + 1)))
    for w in range(watches):
        row = outs[n + w]
        if row < 0:
            continue
        for _ in range(100):
            size = abs(C[row, 0])
            power = 1.0
            for k in range(1, p - 1):
                power *= h
                size = max(size, abs(C[row, k]) * power)
            last = abs(C[row, p - 1]) * power * h + abs(C[row, p]) * power * h * h
            if not np.isfinite(last):
                if not np.isfinite(C[row, p - 1] + C[row, p]):
                    return 0.0
                h *= 0.5
            elif last <= SHARP * size:
                break
            else:
                h *= max(0.5, 0.9 * (SHARP * size / last) ** (1.0 / p))
    return h


@summing
def _tail(Q, i, p, derivative):
    """Bound on coefficient ORDER, anywhere on the piece, of the polynomial Q[i], or of its
    derivative in s."""
    s = 0.0
    for k in range(ORDER, p + 1 - derivative):
        s += CHOOSE[k, ORDER] * abs(Q[i, k + derivative]) * (1.0 + derivative * k)
    return s


@inner
def _at_nodes(Q, i, p, derivative, out, to):
    """out[to, :ORDER]: values at NODES of the polynomial Q[i], or of its derivative in s."""
    for j in range(ORDER):
        out[to, j] = 0.0
    for k in range(p - derivative, -1, -1):
        term = Q[i, k + derivative] * (1.0 + derivative * k)
        for j in range(ORDER):
            out[to, j] += POWERS[k, j] * term


@inner
def certified(
    ops, nums, lo, hi, outs, n, p, watches, t, start, width, whole, local, C, Q, M, R, V, error
):
    """The piece [t + start, t + start + width] of a step `whole` long is certified if this is >= 1.

    It is the least quotient of a bound that counts as smooth and the bound found; 0 if it fails
    otherwise.
    Q (n + watches, p + 1): the polynomials of state and watched functions in s on the piece; error
    (watches,): bounds on what the latter miss of the functions. C: table of the step; M, R, V:
    scratch.
    """
    radius = 0.5 * width
    middle = start + radius
    biggest = 1.0
    room = np.inf
    for i in range(n):
        shifted(C, i, p, middle, radius, Q, i)
        biggest = max(biggest, 1.0 + abs(Q[i, 0]))
    for w in range(watches):
        if outs[n + w] >= 0:
            shifted(C, outs[n + w], p, middle, radius, Q, n + w)
    path(Q, n, p, t + middle, radius, M, R)
    enclose(ops, nums, lo, hi, n, M, R)
    least = biggest / max(whole, 1.0)
    pace = 0.0
    for i in range(n):
        pace = max(pace, abs(M[outs[i], 0]) - R[outs[i], 0])
    for i in range(n):
        row = outs[i]
        bound = abs(M[row, ORDER]) + R[row, ORDER] + _tail(Q, i, p, 1) / radius
        room = min(room, RESOLVED * max(pace, least) / (bound * HALF))
        if not room >= 1.0:
            return room
    for w in range(watches):
        row = outs[n + w]
        error[w] = 0.0
        if row >= 0:
            size = max(abs(M[row, 0]) - R[row, 0], least if w < watches - 1 else 1.0)
            bound = abs(M[row, ORDER]) + R[row, ORDER] + _tail(Q, n + w, p, 0)
            room = min(room, RESOLVED * size / (bound * HALF))
            if not room >= 1.0:
                return room
            error[w] = bound * HALF
    for i in range(n):
        _at_nodes(Q, i, p, 0, V, i)
    for k in range(ORDER):
        V[n, k] = t + start + radius * (1.0 + NODES[k])
    point(ops, nums, lo, hi, n, V, ORDER)
    for i in range(n):
        _at_nodes(Q, i, p, 1, M, 0)
        for k in range(ORDER):
            off = abs(M[0, k] / radius - V[outs[i], k]) * whole
            if not off <= DEFECT * local * (1.0 + abs(V[i, k])) + 1e-14 * whole * abs(pace):
                return 0.0
    for w in range(watches):
        row = outs[n + w]
        if row >= 0:
            _at_nodes(Q, n + w, p, 0, M, 0)
            for k in range(ORDER):
                off = abs(M[0, k] - V[row, k])
                error[w] += 0.5 * off + 2e-16 * abs(V[row, k])
                if (
                    w == watches - 1
                    and not 0.5 * off * whole <= DEFECT * local + 1e-14 * whole * abs(V[row, k])
                ):
                    return 0.0  # twice the weight, which is integrated
    return room


@inner
def shorter(room):
    """Part of a piece with this `room` that the certificate should hold for: bounds go with the
    power ORDER of the width.

    Those of pieces far too long explode instead: they tell nothing, and a quarter is tried.
    """
    return max(0.9 * room ** (1.0 / ORDER), 0.25) if room > 0.0 else 0.5


@inner
def lifted(C, row, p, h, band):
    """w in (0, h] such that the series u = C[row], at most `band` at 0, exceeds it at w without
    falling below by more before.

    0: it stays within the band on [0, h]; -1: neither is certain.
    """
    w = h
    for _ in range(50):
        below = 0.0
        power = 1.0
        for lead in range(1, min(7, p)):
            power *= w
            rest = 0.0
            q = 1.0
            for k in range(lead + 1, p + 1):
                q *= w
                rest += abs(C[row, k]) * q
            if below <= 0.5 * band and C[row, lead] > 0.0 and rest <= 0.5 * C[row, lead]:
                if horner(C, row, w, p) > band:
                    return w
                break
            below += max(-C[row, lead], 0.0) * power
        w *= 0.5
    swing = 0.0
    q = 1.0
    for k in range(1, p + 1):
        q *= h
        swing += abs(C[row, k]) * q
    return 0.0 if swing <= 0.5 * band else -1.0


@inner
def first_event(outs, n, p, watches, start, width, C, Q, error, lift, stack, work):
    """(CLEAR, FOUND or UNCLEAR, which function, time from the step's start) of the first event on a
    certified piece."""
    first = np.inf
    which = -1
    for w in range(watches):
        row = outs[n + w]
        if row < 0 or lift[w] < 0.0 or lift[w] >= start + width:
            continue
        lo = start
        radius = 0.5 * width
        if lift[w] > start:
            lo = lift[w]
            radius = 0.5 * (start + width - lift[w])
            shifted(C, row, p, lo + radius, radius, Q, n + w)
        size = 0.0
        for k in range(p + 1):
            size += abs(Q[n + w, k])
        code, s = first_fall(Q, n + w, p, 4.0 * error[w] + 1e-15 * size, stack, work)
        if code == FOUND:
            time = lo + radius * (1.0 + s)
            if time < first:
                first = time
                which = w
        elif code != CLEAR:
            time = lo + radius * (1.0 + s)
            if time < first:
                first = time
                which = -2
    if which == -2:
        return 2, -1, first
    return (FOUND, which, first) if which >= 0 else (CLEAR, -1, np.inf)
