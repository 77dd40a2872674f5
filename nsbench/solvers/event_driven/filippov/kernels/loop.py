"""The walk of a Filippov system from mode to mode, compiled: Taylor steps, events, and the choices
that are plain.

What is not plain goes back to the caller, with the state at that time: surfaces met together,
tangential meetings that a trial does not settle, fields that are the same on both sides, motions
that are not unique, steps that cannot be certified.
"""

import numpy as np

from nsbench.compilation.decorators import njit
from nsbench.solvers.event_driven.filippov.kernels.certified_step import (
    certified,
    first_event,
    length,
    lifted,
    shorter,
)
from nsbench.solvers.event_driven.filippov.kernels.mode_choice import (
    EPS,
    FLAT,
    UNKNOWN,
    at,
    band,
    choose_mode,
    geometry,
    program,
    project,
    surface_met,
)
from nsbench.solvers.event_driven.filippov.kernels.polynomial_root import CLEAR, FOUND
from nsbench.solvers.event_driven.filippov.kernels.taylor_series import horner, inner, point, series

# why `walk` returns
END = 0
MEET = 1
HARD = 2
STEPS = 3
FULL = 4
START = 5
TINY = -3  # FIRED, with HARD: steps vanish
ARC_BAND = 16.0  # as in solvers._switching
SPLIT = 1.5  # pieces: a step little longer than one is shortened instead
PIECES = 16  # of a step: a shorter step is cheaper than more of them
WINDOW = 3  # as in solvers._switching
# steps of one arc, and those to come: the equation is stiff
MANY = 4000
AHEAD = 1e6
# indices of the integers and floats of a walk
CODE, DONE, COUNT, ARCS, CALLS, EVENTS, MEETINGS, FIRED, CARRY = range(9)
TIME, LONGEST = range(2)


@inner
def accumulate(ring, count, span):
    """Whether the meetings (the last seven in ring, latest last) accumulate (see
    solvers._switching)."""
    if count <= 2 * WINDOW:
        return False
    last = ring[6] - ring[3]
    before = ring[3] - ring[0]
    if last + before <= 16 * EPS * abs(ring[6]):
        return True
    ratio = last / before if before > 0.0 else 1.0
    return ratio < 0.9 and last * ratio / (1.0 - ratio) <= 1e-10 * span


@inner
def landed(ops, nums, first, outs, m, n, p, w, t, s, h, C, V):
    """Time from the step's start at which watched function w vanishes, near s: Newton's method on
    the function itself."""
    row = outs[m, n + w]
    for _ in range(4):
        for j in range(n):
            V[j, 0] = horner(C, j, s, p)
        V[n, 0] = t + s
        point(ops, nums, first[m, 0], first[m, 2], n, V, 1)
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


@inner
def step(
    ops,
    nums,
    first,
    outs,
    m,
    n,
    d,
    p,
    t,
    x,
    most,
    held,
    local,
    armed,
    edge,
    C,
    Q,
    M,
    R,
    V,
    error,
    lift,
    stack,
    work,
):
    """One step in program m: (code, length, fired, held). CLEAR: go on after `length`; FOUND:
    event; HARD: not certain.

    held: a width for which the certificate should hold; handed on from step to step, so that it
    seldom fails.
    """
    for j in range(n):
        C[j, 0] = x[j]
    C[n, 0] = t
    series(ops, nums, first[m, 0], first[m, 1], first[m, 2], outs[m], n, p, C)
    h = length(C, n, p, x, outs[m], d + 1, local, most)
    watches = d + 1
    tiny = 64.0 * EPS * abs(t)
    if not h > min(tiny, 0.5 * most):
        return HARD, 0.0, TINY, held
    for w in range(watches):
        row = outs[m, n + w]
        lift[w] = 0.0
        if row >= 0 and not armed[w]:
            lift[w] = lifted(C, row, p, h, edge[w])
            if lift[w] < 0.0:
                return HARD, 0.0, -1, held
            if lift[w] == 0.0:
                lift[w] = np.inf
    if held < h < SPLIT * held:
        h = held
    start = 0.0
    width = h / np.ceil(h / held)
    pieces = 0
    whole = h
    while start < h:
        if width > 0.999 * (h - start):
            width = h - start
        room = certified(
            ops,
            nums,
            first[m, 0],
            first[m, 2],
            outs[m],
            n,
            p,
            watches,
            t,
            start,
            width,
            whole,
            local,
            C,
            Q,
            M,
            R,
            V,
            error,
        )
        fits = shorter(room) * width
        held = (
            max(held, fits) if room >= 1.0 and width < 0.7 * held else fits
        )  # short pieces tell little of longer ones
        if not room >= 1.0:
            width = fits
            if start == 0.0 and h < SPLIT * width:
                whole = h = width
            if start > 0.0 and width < whole / PIECES:
                break
            if width < tiny or width < 1e-12 * whole:
                return HARD, 0.0, -1, held
            if start == 0.0 and width < whole / PIECES:
                whole = h = min(h, width * PIECES)
            continue
        code, w, s = first_event(
            outs[m], n, p, watches, start, width, C, Q, error, lift, stack, work
        )
        if code == FOUND:
            s = landed(ops, nums, first, outs, m, n, p, w, t, s, h, C, V)
            return (FOUND, s, w, held) if s >= 0.0 else (HARD, 0.0, -1, held)
        if code != CLEAR:
            return (CLEAR, start, -1, held) if start > 0.0 else (HARD, 0.0, -1, held)
        start += width
        pieces += 1
        if pieces >= PIECES:
            break
    return CLEAR, start if start < h else h, -1, held


@inner
def begin(ops, nums, first, outs, m, n, d, i, t, x, V, G, armed, edge):
    """Which functions are armed at the start of an arc, and the bands of those that are not."""
    geometry(ops, nums, first, outs, n, d, t, x, V, G)
    for k in range(d):
        edge[k] = band(G, k, t, x, ARC_BAND)
    if i >= 0:
        edge[i] = FLAT
    edge[d] = FLAT
    at(ops, nums, first, outs, m, n, t, x, V)
    fine = True
    for k in range(d + 1):
        row = outs[m, n + k]
        value = V[row, 0] if row >= 0 else 1.0
        fine = fine and np.isfinite(value) and value >= -edge[k]
        armed[k] = value > edge[k]
    return fine


@inner
def record(
    ops,
    nums,
    first,
    outs,
    n,
    d,
    p,
    i,
    t,
    reach,
    last,
    times,
    done,
    mode,
    weights,
    C,
    X,
    W,
    theta,
    V,
    G,
):
    """Write the samples up to t + reach (all that are left if `last`); returns how many are done by
    then."""
    while done < times.size and (times[done] <= t + reach or last):
        s = min(times[done] - t, reach)
        for j in range(n):
            X[done, j] = horner(C, j, s, p)
        if i >= 0:
            project(ops, nums, first, outs, n, d, i, times[done], X[done], V, G)
        integrals(d, p, i, s, mode, weights, C, theta, W[done])
        done += 1
    return done


@inner
def integrals(d, p, i, s, mode, row, C, theta, out):
    """Integrals of the weights after time s of a step; row: of the weight of the surface slid
    on."""
    for k in range(d):
        if k == i:
            y = 0.0
            for q in range(p, -1, -1):
                y = y * s + C[row, q] / (q + 1)
            out[k] = theta[k] + s * y
        else:
            out[k] = theta[k] + (s if mode[k] == 1 else 0.0)


@inner
def log_event(i, old, new, t, theta, numbers, ring, log, logged):
    """Write down an event and the meeting that it was."""
    e = numbers[EVENTS]
    log[e, 0] = t
    log[e, 1] = theta[i]
    logged[e, 0] = i
    logged[e, 1] = old
    logged[e, 2] = new
    numbers[EVENTS] += 1
    numbers[MEETINGS] += 1


@njit(cache=True, error_model="numpy")
def integrate_modes(
    ops,
    nums,
    first,
    outs,
    table,
    slides,
    p,
    limits,
    begun,
    numbers,
    floats,
    x,
    theta,
    mode,
    armed,
    ring,
    times,
    X,
    W,
    log,
    logged,
    scratch,
):
    """Follow the motion until the end or until something is not plain; numbers[CODE] tells which.

    limits: span, local error, longest step, most steps, most meetings. begun: 0 the mode is to be
    chosen, 1 an arc begins, 2 it goes on (armed is given). ring (7,): last meetings. log (cap, 2):
    time and weight integral of events, logged (cap, 3): surface, mode before, after. scratch: C, Q,
    M, R, V, error, lift, stack, work, edge, G, F, y, D.
    """
    n = x.size
    d = mode.size
    C, Q, M, R, V, error, lift, stack, work, edge, G, F, y, D = scratch
    span = limits[0]
    local = limits[1]
    T = times[-1]
    t = floats[TIME]
    in_arc = 0
    who = -1
    held = np.inf
    if begun == 0:
        who = surface_met(ops, nums, first, outs, n, d, t, x, mode, -1, V, G)
    while True:
        if who == -2:
            numbers[CODE] = START if begun == 0 else MEET
            break
        if who >= 0:
            old = mode[who]
            q = choose_mode(
                ops, nums, first, outs, table, n, d, p, who, mode, t, x, span, local, V, G, F, D, y
            )
            mode[who] = old
            if q == UNKNOWN or (begun > 0 and q == old):
                numbers[CODE] = START if begun == 0 else MEET
                break
            mode[who] = q
            if begun > 0:
                log_event(who, old, q, t, theta, numbers, ring, log, logged)
                if t >= T:
                    numbers[CODE] = END
                    break
            begun = 1
            who = -1
            if numbers[EVENTS] == log.shape[0]:
                numbers[CODE] = FULL
                numbers[CARRY] = 0
                break
        m = program(table, mode)
        if m < 0:
            numbers[CODE] = HARD
            numbers[CARRY] = 0
            break
        i = slides[m]
        if begun < 2:
            if i >= 0:
                project(ops, nums, first, outs, n, d, i, t, x, V, G)
            numbers[CARRY] = 0
            if not begin(ops, nums, first, outs, m, n, d, i, t, x, V, G, armed, edge):
                numbers[CODE] = HARD
                break
            numbers[ARCS] += 1
            in_arc = 0
            begun = 2
        if numbers[COUNT] >= limits[3]:
            numbers[CODE] = STEPS
            break
        numbers[CARRY] = 1
        code, h, fired, held = step(
            ops,
            nums,
            first,
            outs,
            m,
            n,
            d,
            p,
            t,
            x,
            min(limits[2], T - t),
            held,
            local,
            armed,
            edge,
            C,
            Q,
            M,
            R,
            V,
            error,
            lift,
            stack,
            work,
        )
        if code == HARD or (in_arc > MANY and T - t > AHEAD * h):
            numbers[CODE] = HARD
            numbers[FIRED] = fired
            break
        numbers[COUNT] += 1
        numbers[CALLS] += (p + 1) * (2 if i >= 0 else 1)
        in_arc += 1
        floats[LONGEST] = max(floats[LONGEST], h)
        last = code == CLEAR and h >= T - t
        weights = outs[m, n + d + 1]
        numbers[DONE] = record(
            ops,
            nums,
            first,
            outs,
            n,
            d,
            p,
            i,
            t,
            h,
            last,
            times,
            numbers[DONE],
            mode,
            weights,
            C,
            X,
            W,
            theta,
            V,
            G,
        )
        integrals(d, p, i, h, mode, weights, C, theta, theta)
        for j in range(n):
            x[j] = horner(C, j, h, p)
        for k in range(d + 1):
            if outs[m, n + k] >= 0 and not armed[k]:
                armed[k] = horner(C, outs[m, n + k], h, p) > edge[k]
        t = T if last else t + h
        if i >= 0:
            project(ops, nums, first, outs, n, d, i, t, x, V, G)
        if last:
            numbers[CODE] = END
            break
        if code == FOUND:
            numbers[FIRED] = fired
            for k in range(6):
                ring[k] = ring[k + 1]
            ring[6] = t
            who = -2
            if numbers[MEETINGS] < limits[4] and not accumulate(ring, numbers[MEETINGS] + 1, span):
                who = surface_met(
                    ops, nums, first, outs, n, d, t, x, mode, i if fired == d else fired, V, G
                )
    floats[TIME] = t
