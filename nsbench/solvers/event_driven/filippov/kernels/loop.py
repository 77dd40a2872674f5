"""Compiled loop of a Filippov system from mode to mode: Taylor steps, events, proven choices.

What is not certain goes back to the caller, with the state at that time: surfaces reached together,
tangential arrivals that a trial does not settle, fields that are the same on both sides, motions
that are not unique, steps that cannot be certified.
"""

import numpy as np

from nsbench.compilation.borrowed_arrays import borrowed
from nsbench.compilation.decorators import inlined, inner_kernel, njit
from nsbench.solvers.event_driven.filippov.kernels.kink_branches import begin_kinks
from nsbench.solvers.event_driven.filippov.kernels.loop_state import (
    CALLS,
    CARRY,
    CODE,
    COUNT,
    DONE,
    END,
    FIRED,
    HARD,
    LONGEST,
    STEPS,
    TIME,
    Kinks,
    Modes,
    Motion,
    Programs,
    Records,
    Run,
    Settings,
    Workspace,
)
from nsbench.solvers.event_driven.filippov.kernels.mode_change import (
    ARC_BEGINS,
    CHOOSE_START,
    begin_arc,
    pass_event,
)
from nsbench.solvers.event_driven.filippov.kernels.mode_choice import (
    NO_SURFACE,
    project_onto_surface,
    surface_met,
)
from nsbench.solvers.event_driven.filippov.kernels.polynomial_root import CLEAR, FOUND
from nsbench.solvers.event_driven.filippov.kernels.step_to_event import TOUCH, take_step
from nsbench.solvers.event_driven.filippov.kernels.taylor_series import horner

# steps of one arc, and those to come at the present length, beyond which the equation is stiff
STIFF_STEPS = 4000
STIFF_STEPS_AHEAD = 1e6


@inner_kernel
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
    T = run.records.times[-1]
    t = run.floats[TIME]
    m = np.int64(-1)
    i = np.int64(-1)
    steps_of_arc = 0
    surface = np.int64(NO_SURFACE)  # no literal: one version of choose_mode
    certified_width = np.inf
    held = np.int64(-1)
    if begun == CHOOSE_START:
        begin_kinks(programs, mode.size, t, x, work.V, work.G)
        surface = surface_met(programs, t, x, mode, surface, work.V, work.G)
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
            programs, m, p, settings.local_error, longest, t, x, motion.armed, certified_width, work
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
            project_onto_surface(programs, i, t, x, work.V, work.G)
        if last:
            counters[CODE] = END
            break
        if code == FOUND or code == TOUCH:
            surface, held = pass_event(run, m, i, fired, code == TOUCH, t)
            m = np.int64(-1)
            if held >= 0 and t >= T:
                counters[CODE] = END
                break
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
    run = borrowed(run)
    follow_modes(run, begun)
