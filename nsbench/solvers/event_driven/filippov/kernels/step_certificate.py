"""Certificate that a piece of a Taylor step hides no event; the step's length; its first event.

The program of a mode (see event_driven.filippov.program) has the outputs F (n), watch (d + 2 K + 1)
and theta. watch[k] > 0 until surface k is reached, or, for the surface it slides on, until its
weight is used up: 1 - s there, and 1 + s as the last one; two for each kink are in between.

Certificate of a piece of the step: the fields and the watched functions along the polynomial path
are enclosed with their first ORDER derivatives (kernels.enclosure), and so are those of the
polynomials that stand for them; at NODES the two agree. So they agree in between, up to the bound
on interpolation (Davis, Interpolation and Approximation, 1963, theorem 3.1.1), and nothing narrower
than the piece hides in it.
"""

import numpy as np

from nsbench.compilation.decorators import fused_kernel, inner_kernel, summing_kernel
from nsbench.solvers.event_driven.filippov.kernels.enclosure import ORDER, enclose, path
from nsbench.solvers.event_driven.filippov.kernels.polynomial_root import (
    CHOOSE,
    CLEAR,
    DEGREE,
    FOUND,
    UNCLEAR,
    first_fall,
    shifted,
)
from nsbench.solvers.event_driven.filippov.kernels.taylor_series import horner, point

# Chebyshev nodes of the interpolation behind the certificate
NODES = -np.cos(np.pi * np.arange(ORDER) / (ORDER - 1))
NODE_POWERS = NODES ** np.arange(DEGREE + 1)[:, None]
# bound on the interpolation error, from the coefficient of order ORDER
INTERPOLATION = 1.0 / 2.0 ** (ORDER - 2)
# relative bound on interpolation that counts as smooth (as in event_driven.smooth.pieces)
SMOOTH = 1e-10
DEFECT = 100.0  # local errors by which the path may miss the equation at a node
# truncation of the watched functions, relative to what they reach on the step; roots are polished
WATCH_TRUNCATION = 1e-9
HALVINGS = 50  # of a step in which a watched function may leave its band
LENGTH_TRIALS = 100  # reductions of a step length for the watched functions


@inner_kernel
def step_length(C, n, p, x, outs, watches, local, most):
    """Return a step on which the last terms of the state are below local (1 + |x|), those of the
    integral of the weight below local, and those of the watched functions below WATCH_TRUNCATION of
    their size; 0 if a coefficient is not finite.

    C: Taylor coefficients (see taylor_series.series); outs: outputs of the program; most: longest
    step. Source: Jorba & Zou, Experimental Mathematics 14 (2005), section 3.2.
    """
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
        for _ in range(LENGTH_TRIALS):
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
            elif last <= WATCH_TRUNCATION * size:
                break
            else:
                h *= max(0.5, 0.9 * (WATCH_TRUNCATION * size / last) ** (1.0 / p))
    return h


@summing_kernel
def tail(Q, i, p, derivative):
    """Bound coefficient ORDER, anywhere on the piece, of the polynomial Q[i], or of its derivative
    in s."""
    s = 0.0
    for k in range(ORDER, p + 1 - derivative):
        s += CHOOSE[k, ORDER] * abs(Q[i, k + derivative]) * (1.0 + derivative * k)
    return s


@inner_kernel
def at_nodes(Q, i, p, derivative, out, to):
    """Fill out[to, :ORDER] with the values at NODES of the polynomial Q[i], or of its derivative in
    s."""
    for j in range(ORDER):
        out[to, j] = 0.0
    for k in range(p - derivative, -1, -1):
        term = Q[i, k + derivative] * (1.0 + derivative * k)
        for j in range(ORDER):
            out[to, j] += NODE_POWERS[k, j] * term


@fused_kernel
def certify_piece(programs, m, n, p, watches, t, start, width, whole, local, C, Q, M, R, V, error):
    """Return how well the piece [t + start, t + start + width] of a step is certified: the least
    quotient of a bound that counts as smooth and the bound found. It is certified if this is >= 1;
    0 if it fails otherwise.

    whole: length of the step, whose Taylor coefficients are C. Fills Q (n + watches, p + 1), the
    polynomials of state and watched functions in s, |s| <= 1, on the piece, and error (watches,),
    bounds on what the latter miss of the functions. M, R, V: work (see loop_state.Workspace).
    """
    outs = programs.outs[m]
    radius = 0.5 * width
    middle = start + radius
    biggest = 1.0
    for i in range(n):
        shifted(C, i, p, middle, radius, Q, i)
        biggest = max(biggest, 1.0 + abs(Q[i, 0]))
    for w in range(watches):
        if outs[n + w] >= 0:
            shifted(C, outs[n + w], p, middle, radius, Q, n + w)
    path(Q, n, p, t + middle, radius, M, R)
    enclose(programs.ops, programs.nums, programs.first[m], n, M, R)
    least = biggest / max(whole, 1.0)
    pace = 0.0
    for i in range(n):
        pace = max(pace, abs(M[outs[i], 0]) - R[outs[i], 0])
    margin = _smoothness(outs, n, p, watches, radius, least, pace, Q, M, R, error)
    if not margin >= 1.0:
        return margin
    for i in range(n):
        at_nodes(Q, i, p, 0, V, i)
    for k in range(ORDER):
        V[n, k] = t + start + radius * (1.0 + NODES[k])
    point(programs.ops, programs.nums, programs.first[m], n, V, ORDER)
    if _agrees_at_nodes(outs, n, p, watches, radius, whole, local, pace, Q, M, V, error):
        return margin
    return 0.0


@inner_kernel
def _smoothness(outs, n, p, watches, radius, least, pace, Q, M, R, error):
    """Return the least quotient of SMOOTH and the interpolation bounds of fields and watched
    functions; the latter's bounds go to `error`.

    least, pace: sizes that the bounds of the fields are relative to.
    """
    margin = np.inf
    for i in range(n):
        row = outs[i]
        bound = abs(M[row, ORDER]) + R[row, ORDER] + tail(Q, i, p, 1) / radius
        quotient = SMOOTH * max(pace, least) / (bound * INTERPOLATION)
        if not quotient >= 1.0:
            return quotient
        margin = min(margin, quotient)
    for w in range(watches):
        row = outs[n + w]
        error[w] = 0.0
        if row >= 0:
            size = max(abs(M[row, 0]) - R[row, 0], least if w < watches - 1 else 1.0)
            bound = abs(M[row, ORDER]) + R[row, ORDER] + tail(Q, n + w, p, 0)
            quotient = SMOOTH * size / (bound * INTERPOLATION)
            if not quotient >= 1.0:
                return quotient
            margin = min(margin, quotient)
            error[w] = bound * INTERPOLATION
    return margin


@inner_kernel
def _agrees_at_nodes(outs, n, p, watches, radius, whole, local, pace, Q, M, V, error):
    """Does the path satisfy the equation at NODES, and do the polynomials of the watched functions
    agree with them there? What the latter miss is added to work.error."""
    for i in range(n):
        at_nodes(Q, i, p, 1, M, 0)
        for k in range(ORDER):
            off = abs(M[0, k] / radius - V[outs[i], k]) * whole
            if not off <= DEFECT * local * (1.0 + abs(V[i, k])) + 1e-14 * whole * abs(pace):
                return False
    for w in range(watches):
        row = outs[n + w]
        if row >= 0:
            at_nodes(Q, n + w, p, 0, M, 0)
            for k in range(ORDER):
                off = abs(M[0, k] - V[row, k])
                error[w] += 0.5 * off + 2e-16 * abs(V[row, k])
                # the last one is twice the weight, which is integrated
                if (
                    w == watches - 1
                    and not 0.5 * off * whole <= DEFECT * local + 1e-14 * whole * abs(V[row, k])
                ):
                    return False
    return True


@inner_kernel
def fitting_part(margin):
    """Return the part of a piece with this margin for which the certificate should hold: bounds go
    with the power ORDER of the width.

    Bounds of pieces far too long explode instead and say nothing; a quarter is tried then.
    """
    return max(0.9 * margin ** (1.0 / ORDER), 0.25) if margin > 0.0 else 0.5


@inner_kernel
def lift_time(C, row, p, h, band):
    """Return w in (0, h] such that the series u = C[row], at most `band` at 0, exceeds it at w
    without falling below by more before; 0: it stays within the band on [0, h]; -1: neither is
    certain."""
    w = h
    for _ in range(HALVINGS):
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


@inner_kernel
def first_event(outs, n, p, watches, start, width, C, Q, error, lift, stack, work):
    """Find the first fall of a watched function through zero on a certified piece.

    Returns CLEAR, FOUND or UNCLEAR (the first candidate is not certain); the watched function, -1
    for none; its time from the step's start, inf for none.
    """
    first = np.inf
    which = -1
    result = CLEAR
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
        if code != CLEAR:
            time = lo + radius * (1.0 + s)
            if time < first:
                first = time
                which = w
                result = code
    return result, which, first
