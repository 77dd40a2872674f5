"""Take one Taylor step of a Filippov mode, certified piece by piece, up to its first event.

The step is expanded once; the certificate (kernels.step_certificate) is then checked piece by
piece, and the step ends at the first event, or where the certificate would cost more than another
step.
"""

import numpy as np

from nsbench.compilation.decorators import inlined, inner_kernel
from nsbench.solvers.event_driven.filippov.kernels.loop_state import HARD, STEP_VANISHES
from nsbench.solvers.event_driven.filippov.kernels.mode_choice import EPS
from nsbench.solvers.event_driven.filippov.kernels.polynomial_root import CLEAR, FOUND
from nsbench.solvers.event_driven.filippov.kernels.step_certificate import (
    certify_piece,
    first_event,
    fitting_part,
    lift_time,
    step_length,
)
from nsbench.solvers.event_driven.filippov.kernels.taylor_series import horner, point, series

SPLIT = 1.5  # certified widths: a step little longer than one is shortened instead of divided
PIECES = 16  # most pieces of a step: a shorter step is cheaper than more of them
NO_WATCH = -1  # instead of the number of a watched function
TOUCH = 3  # code of a step that ends where a kink is touched, beside CLEAR, FOUND and HARD
POLISHES = 4  # Newton steps on the event time: quadratic, from a root of the polynomial
TOUCH_POLISHES = 60  # on the time of a touch: linear where it is a root of higher order


@inlined
def polish_event(programs, m, w, n, p, t, s, h, C, V):
    """Return the time from the step's start at which watched function w vanishes, near s: Newton's
    method on the function itself, with the slope of its Taylor polynomial; -1 if it does not
    converge."""
    row = programs.outs[m, n + w]
    for _ in range(POLISHES):
        for j in range(n):
            V[j, 0] = horner(C, j, s, p)
        V[n, 0] = t + s
        point(programs.ops, programs.nums, programs.first[m], n, V, 1)
        slope = 0.0
        for k in range(p, 0, -1):
            slope = slope * s + k * C[row, k]
        move = -V[row, 0] / slope
        if not (slope < 0.0 and abs(move) <= 1e-3 * h):
            return -1.0
        s = min(max(s + move, 0.0), h)
        if abs(move) <= 2.0 * EPS * max(abs(t + s), h):
            break
    return s


@inner_kernel
def _touch_time(programs, outs, n, p, watches, w, t, s, h, C, band):
    """Return the time near s from the step's start at which watched function w, of a kink, touches
    zero: a zero of its slope, by Newton's method; -1 if it is of no kink or not within rounding of
    zero there."""
    kinks = 2 * programs.kinks.state.size
    if not watches - 1 - kinks <= w < watches - 1:
        return -1.0
    row = outs[n + w]
    for _ in range(TOUCH_POLISHES):
        slope = 0.0
        bend = 0.0
        for k in range(p, 0, -1):
            bend = bend * s + slope
            slope = slope * s + k * C[row, k]
        if bend == 0.0:
            break
        move = -slope / bend
        s = min(max(s + move, 0.0), h)
        if abs(move) <= 2.0 * EPS * max(abs(t + s), h):
            break
    return s if s > 0.0 and abs(horner(C, row, s, p)) <= band[w] else -1.0


@inlined
def take_step(programs, m, p, local, longest, t, x, armed, certified_width, work):
    """Take one step of order p in program m from (t, x), at most `longest`.

    local: error allowed. armed (w,): watched functions that can fall through zero.
    certified_width: a width for which the certificate should hold; it is handed on from step to
    step, so that the certificate seldom fails.
    Returns CLEAR (go on after `length`), FOUND (an event), TOUCH (a kink is touched, or reached
    slowly: its state is to be settled) or HARD (not certain); the length; the watched function that
    fell or touched zero, NO_WATCH or STEP_VANISHES; the certified width for the next step.
    Taylor coefficients are left in work.C.
    """
    n = x.size
    C = work.C
    lift = work.lift
    outs = programs.outs
    for j in range(n):
        C[j, 0] = x[j]
    C[n, 0] = t
    series(programs.ops, programs.nums, programs.first[m], outs[m], n, p, C)
    watches = armed.size
    h = step_length(C, n, p, x, outs[m], watches, local, longest)
    tiny = 64.0 * EPS * abs(t)
    if not h > min(tiny, 0.5 * longest):
        return HARD, 0.0, STEP_VANISHES, certified_width
    # a function that is not armed starts within its band: it must leave it upwards, or stay
    for w in range(watches):
        row = outs[m, n + w]
        lift[w] = 0.0
        if row >= 0 and not armed[w]:
            lift[w] = lift_time(C, row, p, h, work.band[w])
            if lift[w] < 0.0:
                return HARD, 0.0, NO_WATCH, certified_width
            if lift[w] == 0.0:
                lift[w] = np.inf
    return _certify_step(programs, m, p, t, n, watches, h, tiny, certified_width, local, work)


@inlined
def _certify_step(programs, m, p, t, n, watches, h, tiny, certified_width, local, work):
    """Certify the step of length h piece by piece, up to its first event; returns as take_step."""
    outs = programs.outs[m]
    C = work.C
    Q = work.Q
    M = work.M
    R = work.R
    V = work.V
    error = work.error
    if certified_width < h < SPLIT * certified_width:
        h = certified_width
    start = 0.0
    width = h / np.ceil(h / certified_width)
    pieces = 0
    whole = h
    while start < h:
        if width > 0.999 * (h - start):
            width = h - start
        margin = certify_piece(
            programs, m, n, p, watches, t, start, width, whole, local, C, Q, M, R, V, error
        )
        fits = fitting_part(margin) * width
        # short pieces tell little of longer ones
        if margin >= 1.0 and width < 0.7 * certified_width:
            certified_width = max(certified_width, fits)
        else:
            certified_width = fits
        if not margin >= 1.0:
            width = fits
            if start == 0.0 and h < SPLIT * width:
                h = width
                whole = h
            if start > 0.0 and width < whole / PIECES:
                break
            if width < tiny or width < 1e-12 * whole:
                return HARD, 0.0, NO_WATCH, certified_width
            if start == 0.0 and width < whole / PIECES:
                h = min(h, width * PIECES)
                whole = h
            continue
        code, w, s = first_event(
            outs, n, p, watches, start, width, C, Q, error, work.lift, work.stack, work.shifted
        )
        if code == FOUND:
            s = polish_event(programs, m, w, n, p, t, s, h, C, V)
            return (FOUND if s >= 0.0 else HARD), s, w, certified_width
        if code != CLEAR:
            s = _touch_time(programs, outs, n, p, watches, w, t, s, h, C, work.band)
            if s > 0.0:
                return TOUCH, s, w, certified_width
            return (CLEAR if start > 0.0 else HARD), start, NO_WATCH, certified_width
        start += width
        pieces += 1
        if pieces >= PIECES:
            break
    return CLEAR, start if start < h else h, NO_WATCH, certified_width
