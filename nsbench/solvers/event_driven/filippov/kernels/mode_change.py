"""What follows an event of the compiled Filippov loop: pass a kink, choose a mode, begin an arc."""

import numpy as np

from nsbench.compilation.decorators import inlined, inner_kernel
from nsbench.solvers.event_driven.filippov.kernels.kink_branches import (
    SETTLED,
    UNCERTAIN,
    cross_kink,
    kink_band,
    leads_away,
    place_kinks,
    settle_kinks,
)
from nsbench.solvers.event_driven.filippov.kernels.loop_state import (
    APART,
    ARCS,
    CARRY,
    CODE,
    END,
    EVENTS,
    FIRED,
    FULL,
    HARD,
    KINK,
    MEET,
    MEETINGS,
    MODE_AFTER,
    MODE_BEFORE,
    RING,
    START,
    SURFACE,
    WINDOW,
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

# roundings of c_i below which a watched function is not armed at the start of an arc
ARC_BAND = 16.0

# how the loop begins, in the argument `begun` of integrate_modes
CHOOSE_START = 0  # with the choice of the mode at the start
ARC_BEGINS = 1  # in a given mode


@inner_kernel
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
    run.records.logged[e, SURFACE] = i
    run.records.logged[e, MODE_BEFORE] = old
    run.records.logged[e, MODE_AFTER] = new
    run.counters[EVENTS] += 1
    run.counters[MEETINGS] += 1


@inner_kernel
def is_beside(run, k, t):
    """Is the state beyond rounding of surface k? work.G is left with the geometry there."""
    x = run.motion.x
    evaluate_geometry(run.programs, t, x, run.work.V, run.work.G)
    return abs(run.work.G[k, x.size + 1]) > rounding_band(run.work.G, k, t, x, ARC_BAND)


@inner_kernel
def follow_jumps(run, t):
    """Change the mode of each surface from which, or across which, its switch has jumped at a kink;
    the events are noted."""
    mode = run.motion.mode
    n = run.motion.x.size
    for k in range(mode.size):
        side = np.sign(run.work.G[k, n + 1]) if is_beside(run, k, t) else 0.0
        old = mode[k]
        if side * old < 0.0 or (side != 0.0 and old == 0):
            mode[k] = np.int64(side)
            log_event(run, k, old, mode[k], t)


@inner_kernel
def pass_kink(run, m, i, kink, t):
    """Change the state of the kink with the watched function `kink`, counted from the first kink's,
    in program m; return the surface i if the motion slid on it and the jump of the drift leaves no
    weight that holds it there (the event is noted then), else NO_SURFACE."""
    motion = run.motion
    cross_kink(run.programs, kink)
    if i < 0 or is_beside(run, i, t):
        return np.int64(NO_SURFACE)
    longest = min(run.settings.longest_step, run.records.times[-1] - t)
    settle_kinks(run, m, kink // 2, t, longest)
    evaluate_program(run.programs, m, t, motion.x, run.work.V)
    n = motion.x.size
    last = motion.armed.size - 1
    outs = run.programs.outs[m]
    V = run.work.V
    if V[outs[n + i], 0] >= -FLAT and V[outs[n + last], 0] >= -FLAT:
        return np.int64(NO_SURFACE)
    return reach_surface(run, i, last, t)


@inlined
def pass_event(run, m, i, fired, touched, t):
    """Return the surface reached (see surface_met) and the kink reached, -1 for none, where the
    watched function `fired` fell in program m, which slides on surface i or -1. touched: it only
    touches zero, and is that of a kink."""
    d = run.motion.mode.size
    kink = fired - d
    if kink < 0 or kink >= 2 * run.programs.kinks.state.size:
        return reach_surface(run, i, fired, t), np.int64(-1)
    surface = np.int64(NO_SURFACE)
    if not touched:
        surface = pass_kink(run, m, i, kink, t)
    return surface, kink // 2


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


@inlined
def has_room(run):
    """Can the log take an event of every surface? If not, the loop ends with the code FULL."""
    counters = run.counters
    if counters[EVENTS] + run.motion.mode.size <= run.records.log.shape[0]:
        return True
    counters[CODE] = FULL
    counters[CARRY] = 0
    return False


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
    return has_room(run)


@inlined
def begin_arc(run, surface, held, t, begun):
    """Choose the mode if a surface was reached, settle the kinks and begin an arc; returns its
    program, or -1, with counters[CODE], if the loop ends. held: kink that was just reached, or
    -1."""
    counters = run.counters
    motion = run.motion
    work = run.work
    is_kinked = run.programs.kinks.state.size > 0
    if is_kinked:
        place_kinks(run.programs, motion.mode.size, held, t, motion.x, work.V, work.G)
        if held >= 0 and surface == NO_SURFACE:
            follow_jumps(run, t)
            if not has_room(run):
                return -1
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
    if is_kinked:
        longest = min(run.settings.longest_step, run.records.times[-1] - t)
        k = settle_kinks(run, m, held, t, longest)
        if k != SETTLED:
            if k != UNCERTAIN:
                counters[CODE] = KINK
            counters[FIRED] = k
            return -1
        k = leads_away(run, m, t, longest) if begun == CHOOSE_START else -1
        if k >= 0:
            counters[CODE] = APART
            counters[FIRED] = k
            return -1
    if not arm_watches(run, m, i, held, t):
        return -1
    counters[ARCS] += 1
    return m
