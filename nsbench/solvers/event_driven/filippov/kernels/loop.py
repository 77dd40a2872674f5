"""Compiled loop of a Filippov system from mode to mode: Taylor steps, events, and the choices of
the next mode that are certain.

What is not certain goes back to the caller, with the state at that time: surfaces reached together,
tangential arrivals that a trial does not settle, fields that are the same on both sides, motions
that are not unique, steps that cannot be certified.
"""

import numpy as np

from nsbench.compilation.decorators import inlined, njit
from nsbench.solvers.event_driven.filippov.kernels.kinks import (
    SETTLED,
    UNCERTAIN,
    cross_kink,
    kink_band,
    leads_away,
    place_kinks,
    set_state,
    settle_kinks,
)
from nsbench.solvers.event_driven.filippov.kernels.loop_state import (
    ARCS,
    CALLS,
    CARRY,
    CODE,
    COUNT,
    DONE,
    END,
    EVENTS,
    FIRED,
    FULL,
    HARD,
    KINK,
    LONGEST,
    MEET,
    MEETINGS,
    RING,
    START,
    STEPS,
    TIME,
    WINDOW,
    Kinks,
    Modes,
    Motion,
    Programs,
    Records,
    Run,
    Settings,
    Workspace,
)
from nsbench.solvers.event_driven.filippov.kernels.mode_choice import (
    EPS,
    FLAT,
    NO_SURFACE,
    SEVERAL_SURFACES,
    UNKNOWN,
    choose_mode,
    evaluate_geometry,
    evaluate_program,
    program_of_mode,
    project_onto_surface,
    rounding_band,
    surface_met,
)
from nsbench.solvers.event_driven.filippov.kernels.polynomial_root import CLEAR, FOUND
from nsbench.solvers.event_driven.filippov.kernels.step_to_event import TOUCH, take_step
from nsbench.solvers.event_driven.filippov.kernels.taylor_series import horner, inner

# roundings of c_i below which a watched function is not armed at the start of an arc
ARC_BAND = 16.0
# steps of one arc, and those to come at the present length, beyond which the equation is stiff
STIFF_STEPS = 4000
STIFF_STEPS_AHEAD = 1e6

# how the loop begins, in the argument `begun` of integrate_modes
CHOOSE_START = 0  # with the choice of the mode at the start
ARC_BEGINS = 1  # in a given mode


@inner
def events_accumulate(ring, count, span):
    """Do the events, the last of `count` in ring with the latest last, accumulate? The test is that
    of event_driven.accumulation."""
    if count <= 2 * WINDOW:
        return False
    last = ring[RING - 1] - ring[RING - 1 - WINDOW]
    before = ring[RING - 1 - WINDOW] - ring[RING - 1 - 2 * WINDOW]
    if last + before <= 16 * EPS * abs(ring[RING - 1]):
        return True
    ratio = last / before if before > 0.0 else 1.0
    return ratio < 0.9 and last * ratio / (1.0 - ratio) <= 1e-10 * span


@inlined
def arm_watches(run, m, i, held, t):
    """Set which watched functions are armed at the start of an arc in program m, sliding on surface
    i or -1, and the bands of those that are not; False if one is below its band. held: kink that
    was just reached, or -1."""
    x = run.motion.x
    armed = run.motion.armed
    band = run.work.band
    V = run.work.V
    G = run.work.G
    n = x.size
    d = run.motion.mode.size
    evaluate_geometry(run.programs, t, x, V, G)
    last = armed.size - 1  # of the weight
    for k in range(d):
        band[k] = rounding_band(G, k, t, x, ARC_BAND)
    for k in range(d, last, 2):
        band[k] = kink_band(run, k - d, held, t)
        band[k + 1] = band[k]
    if i >= 0:
        band[i] = FLAT
    band[last] = FLAT
    evaluate_program(run.programs, m, t, x, V)
    fine = True
    for k in range(armed.size):
        row = run.programs.outs[m, n + k]
        value = V[row, 0] if row >= 0 else 1.0
        fine = fine and np.isfinite(value) and value >= -band[k]
        armed[k] = value > band[k]
    return fine


@inner
def weight_integrals(p, i, s, mode, row, C, theta, out):
    """Fill out (d,) with the integrals of the weights after time s of a step, from theta (d,) at
    its start; row: of the weight of the surface i slid on."""
    for k in range(mode.size):
        if k == i:
            y = 0.0
            for q in range(p, -1, -1):
                y = y * s + C[row, q] / (q + 1)
            out[k] = theta[k] + s * y
        else:
            out[k] = theta[k] + (s if mode[k] == 1 else 0.0)


@inlined
def record_samples(
    programs, outs, weight, i, p, t, h, last, counters, records, mode, theta, C, V, G
):
    """Write the samples up to t + h (all that are left if `last`) of a step in the program with the
    outputs outs, the weight's in the row `weight`, which slides on surface i or -1."""
    times = records.times
    X = records.X
    row = outs[weight]
    done = counters[DONE]
    while done < times.size and (times[done] <= t + h or last):
        s = min(times[done] - t, h)
        for j in range(X.shape[1]):
            X[done, j] = horner(C, j, s, p)
        if i >= 0:
            project_onto_surface(programs, i, times[done], X[done], V, G)
        weight_integrals(p, i, s, mode, row, C, theta, records.W[done])
        done += 1
    counters[DONE] = done


@inlined
def advance_motion(outs, i, p, h, mode, x, theta, armed, band, C):
    """Go to the end of a step of length h: state, weight integrals, armed functions."""
    n = x.size
    weight_integrals(p, i, h, mode, outs[n + armed.size], C, theta, theta)
    for j in range(n):
        x[j] = horner(C, j, h, p)
    for k in range(armed.size):
        if outs[n + k] >= 0 and not armed[k]:
            armed[k] = horner(C, outs[n + k], h, p) > band[k]


@inlined
def reach_surface(run, i, fired, t):
    """Note the time of an event and return the surface reached (see surface_met);
    SEVERAL_SURFACES where events are too many or accumulate. i: the surface slid on, or -1; fired:
    the watched function that fell."""
    motion = run.motion
    ring = run.records.ring
    for k in range(RING - 1):
        ring[k] = ring[k + 1]
    ring[RING - 1] = t
    run.counters[FIRED] = fired
    events = run.counters[MEETINGS]
    if events >= run.settings.events:
        return SEVERAL_SURFACES
    if events_accumulate(ring, events + 1, run.settings.span):
        return SEVERAL_SURFACES
    before = i if fired == motion.armed.size - 1 else fired
    return surface_met(run.programs, t, motion.x, motion.mode, before, run.work.V, run.work.G)


@inlined
def log_event(run, i, old, new, t):
    """Write down an event of surface i, from the mode `old` to `new`."""
    e = run.counters[EVENTS]
    run.records.log[e, 0] = t
    run.records.log[e, 1] = run.motion.theta[i]
    surface_and_modes = run.records.logged[e]
    surface_and_modes[0] = i
    surface_and_modes[1] = old
    surface_and_modes[2] = new
    run.counters[EVENTS] += 1
    run.counters[MEETINGS] += 1


@inlined
def change_mode(run, i, t, begun):
    """Choose the mode of the surface i that was reached and record the event; False, with
    counters[CODE], if the loop ends."""
    motion = run.motion
    mode = motion.mode
    counters = run.counters
    uncertain = START if begun == CHOOSE_START else MEET
    if i == SEVERAL_SURFACES:
        counters[CODE] = uncertain
        return False
    old = mode[i]
    q = choose_mode(run.programs, run.modes, i, t, motion.x, mode, run.settings, run.work)
    mode[i] = old
    if q == UNKNOWN or (begun != CHOOSE_START and q == old):
        counters[CODE] = uncertain
        return False
    mode[i] = q
    if begun != CHOOSE_START:
        log_event(run, i, old, q, t)
        if t >= run.records.times[-1]:
            counters[CODE] = END
            return False
    if counters[EVENTS] == run.records.log.shape[0]:
        counters[CODE] = FULL
        counters[CARRY] = 0
        return False
    return True


@inlined
def begin_arc(run, surface, held, t, begun):
    """Choose the mode if a surface was reached, settle the kinks and begin an arc; returns its
    program, or -1, with counters[CODE], if the loop ends. held: kink that was just reached, or
    -1."""
    counters = run.counters
    motion = run.motion
    work = run.work
    place_kinks(run.programs, motion.mode.size, held, t, motion.x, work.V, work.G)
    if surface != NO_SURFACE and not change_mode(run, surface, t, begun):
        return -1
    m = program_of_mode(run.modes.table, motion.mode)
    counters[CODE] = HARD
    counters[CARRY] = 0
    if m < 0:
        return -1
    i = run.modes.slides[m]
    if i >= 0:
        project_onto_surface(run.programs, i, t, motion.x, work.V, work.G)
    longest = min(run.settings.longest_step, run.records.times[-1] - t)
    k = settle_kinks(run, m, held, t, longest)
    if k != SETTLED:
        if k != UNCERTAIN:
            counters[CODE] = KINK
        counters[FIRED] = k
        return -1
    if begun == CHOOSE_START and leads_away(run, m, t, longest):
        return -1
    if not arm_watches(run, m, i, held, t):
        return -1
    counters[ARCS] += 1
    return m


@inlined
def finish_step(run, m, i, t, h, last):
    """Count a step of length h from time t in program m, which slides on surface i or -1; write its
    samples (all that are left if `last`) and go to its end."""
    p = run.settings.order
    counters = run.counters
    counters[COUNT] += 1
    counters[CALLS] += (p + 1) * (2 if i >= 0 else 1)
    run.floats[LONGEST] = max(run.floats[LONGEST], h)
    motion = run.motion
    work = run.work
    C = work.C
    outs = run.programs.outs[m]
    record_samples(
        run.programs,
        outs,
        motion.x.size + motion.armed.size,
        i,
        p,
        t,
        h,
        last,
        counters,
        run.records,
        motion.mode,
        motion.theta,
        C,
        work.V,
        work.G,
    )
    advance_motion(outs, i, p, h, motion.mode, motion.x, motion.theta, motion.armed, work.band, C)


@inlined
def follow_modes(run, begun):
    """Event loop of integrate_modes: choose the mode where a surface was reached, begin an arc,
    take Taylor steps to the next surface."""
    programs = run.programs
    settings = run.settings
    motion = run.motion
    counters = run.counters
    work = run.work
    p = settings.order
    x = motion.x
    mode = motion.mode
    armed = motion.armed
    V = work.V
    G = work.G
    T = run.records.times[-1]
    t = run.floats[TIME]
    m = np.int64(-1)
    i = np.int64(-1)
    steps_of_arc = 0
    surface = np.int64(NO_SURFACE)  # no literal: one version of choose_mode
    certified_width = np.inf
    kinks = programs.kinks.state.size
    held = np.int64(-1)
    if begun == CHOOSE_START:
        for k in range(kinks):
            set_state(programs, k, 0)
        place_kinks(programs, mode.size, held, t, x, V, G)
        surface = surface_met(programs, t, x, mode, surface, V, G)
    while True:
        if m < 0:
            m = begin_arc(run, surface, held, t, begun)
            if m < 0:
                break
            i = run.modes.slides[m]
            steps_of_arc = 0
            begun = ARC_BEGINS
        if counters[COUNT] >= settings.steps:
            counters[CODE] = STEPS
            break
        counters[CARRY] = 1
        longest = min(settings.longest_step, T - t)
        code, h, fired, certified_width = take_step(
            programs, m, p, settings.local_error, longest, t, x, armed, certified_width, work
        )
        if code == HARD or (steps_of_arc > STIFF_STEPS and T - t > STIFF_STEPS_AHEAD * h):
            counters[CODE] = HARD
            counters[FIRED] = fired
            break
        steps_of_arc += 1
        last = code == CLEAR and h >= T - t
        finish_step(run, m, i, t, h, last)
        t = T if last else t + h
        if i >= 0:
            project_onto_surface(programs, i, t, x, V, G)
        if last:
            counters[CODE] = END
            break
        if code == FOUND:
            m = np.int64(-1)
            kink = fired - mode.size
            held = np.int64(-1)
            if 0 <= kink < 2 * kinks:
                cross_kink(programs, kink)
                held = kink // 2
                surface = np.int64(NO_SURFACE)
                if t >= T:
                    counters[CODE] = END
                    break
            else:
                surface = reach_surface(run, i, fired, t)
        elif code == TOUCH:
            m = np.int64(-1)
            held = (fired - mode.size) // 2
            surface = np.int64(NO_SURFACE)
    run.floats[TIME] = t


@njit(cache=True, error_model="numpy")
def integrate_modes(
    ops,
    nums,
    first,
    outs,
    rows,
    state,
    spans,
    breaks,
    patches,
    entries,
    table,
    slides,
    order,
    span,
    local_error,
    longest_step,
    steps,
    events,
    x,
    theta,
    mode,
    armed,
    times,
    X,
    W,
    log,
    logged,
    ring,
    counters,
    floats,
    work,
    begun,
):
    """Follow the motion until the end or until something is not certain; counters[CODE] tells
    which.

    begun: CHOOSE_START or ARC_BEGINS. The other arguments are the fields of loop_state.Run, one by
    one, and work as a plain tuple: numba needs 15 microseconds more for named ones in each call.
    """
    run = Run(
        Programs(ops, nums, first, outs, rows, Kinks(state, spans, breaks, patches, entries)),
        Modes(table, slides),
        Settings(order, span, local_error, longest_step, steps, events),
        Motion(x, theta, mode, armed),
        Records(times, X, W, log, logged, ring),
        counters,
        floats,
        Workspace(*work),
    )
    follow_modes(run, begun)
