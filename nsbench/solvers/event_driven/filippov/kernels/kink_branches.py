"""Choose the branch of each abs, max and sign of a program: by value, and at a crossing.

The branch is the state 0 .. m of a kink with m breaks (event_driven.filippov.tracing.kinks).

The interpreters know nothing of kinks: what depends on the state of one is a copy of a row or a
constant, and a change of state rewrites these operations in the program (see loop_state.Kinks).
Where a motion reaches a kink, the state is the one in which it goes on: where the drift is
continuous there, the first derivative of the argument that does not vanish is the same in both
states.
"""

import numpy as np

from nsbench.compilation.decorators import inlined, inner_kernel, njit
from nsbench.solvers.event_driven.filippov.kernels.mode_choice import (
    evaluate_geometry,
    evaluate_program,
    rounding_band,
)
from nsbench.solvers.event_driven.filippov.kernels.step_certificate import lift_time, step_length
from nsbench.solvers.event_driven.filippov.kernels.taylor_series import series

# roundings of an argument within which it counts as at its break
KINK_BAND = 16.0
# results of `settle_kinks`; others are the number of a kink to which both sides lead
SETTLED = -1
UNCERTAIN = -2

@inner_kernel
def set_state(programs, k, s):
    """Set the state of kink k, and rewrite the operations that depend on it."""
    kinks = programs.kinks
    kinks.state[k] = s
    begin = kinks.spans[k, 2]
    for e in range(begin, begin + kinks.spans[k, 3]):
        operation = kinks.patches[e, 0]
        entry = kinks.entries[kinks.patches[e, 2] + s]
        if kinks.patches[e, 1] == 1:
            programs.ops[operation, 1] = np.int64(entry)
        else:
            programs.nums[operation, 0] = entry


@njit(cache=True, error_model="numpy")
def place_kinks(programs, d, held, t, x, V, G):
    """Set the states of all kinks by the values of their arguments at (t, x); within rounding of a
    break the state stays, and that of the kink `held` (-1: none), which was just reached.

    d: number of surfaces, before the kinks in G (see evaluate_geometry)."""
    kinks = programs.kinks
    n = x.size
    count = kinks.state.size
    # arguments depend on the states of other kinks: as often as these can be nested
    for _ in range(count + 1 if count > 0 else 0):
        evaluate_geometry(programs, t, x, V, G)
        moved = False
        for k in range(count):
            a = G[d + k, n + 1]
            band = rounding_band(G, d + k, t, x, KINK_BAND)
            lo = kinks.spans[k, 0]
            s = kinks.state[k]
            while s > 0 and a < kinks.breaks[lo + s - 1] - band:
                s -= 1
            while s < kinks.spans[k, 1] and a > kinks.breaks[lo + s] + band:
                s += 1
            if s != kinks.state[k] and k != held:
                set_state(programs, k, s)
                moved = True
        if not moved:
            break


@njit(cache=True, error_model="numpy")
def begin_kinks(programs, d, t, x, V, G):
    """Set the states of all kinks at the start of a run, whatever they were before."""
    for k in range(programs.kinks.state.size):
        set_state(programs, k, 0)
    place_kinks(programs, d, -1, t, x, V, G)


@njit(cache=True, error_model="numpy")
def cross_kink(programs, w):
    """Change the state of the kink whose watched function w, counted from the first one's, fell."""
    k = w // 2
    s = programs.kinks.state[k]
    if programs.kinks.spans[k, 1] == 1:
        set_state(programs, k, 1 - s)
    else:
        set_state(programs, k, s + 1 if w % 2 else s - 1)


@inlined
def kink_band(run, w, held, t):
    """Return what rounding leaves of the watched function w of a kink, counted from the first
    kink's; of the kink `held`, which was just reached, at least what it was on the way there."""
    k = w // 2
    d = run.motion.mode.size
    band = rounding_band(run.work.G, d + k, t, run.motion.x, KINK_BAND)
    if k == held:
        band = max(band, max(run.work.band[d + 2 * k], run.work.band[d + 2 * k + 1]))
    return band


@inner_kernel
def _falling_kink(run, m, held, t, h):
    """Return the first watched function of a kink, counted from the first kink's, that is within
    rounding of zero and falls in program m, whose Taylor coefficients are work.D; SETTLED for none,
    UNCERTAIN if one is not certain to rise, stay or fall."""
    outs = run.programs.outs[m]
    D = run.work.D
    x = run.motion.x
    d = run.motion.mode.size
    p = run.settings.order
    for w in range(2 * run.programs.kinks.state.size):
        row = outs[x.size + d + w]
        band = kink_band(run, w, held, t)
        if row < 0 or D[row, 0] > band or lift_time(D, row, p, h, band) >= 0.0:
            continue
        for k in range(p + 1):
            D[row, k] = -D[row, k]
        return w if lift_time(D, row, p, h, band) > 0.0 else UNCERTAIN
    return SETTLED


@inner_kernel
def expand_motion(programs, m, t, x, settings, watches, longest, D):
    """Fill D with the Taylor coefficients of program m at (t, x); return the length of a step."""
    n = x.size
    p = settings.order
    for j in range(n):
        D[j, 0] = x[j]
    D[n, 0] = t
    outs = programs.outs[m]
    series(programs.ops, programs.nums, programs.first[m], outs, n, p, D)
    return step_length(D, n, p, x, outs, watches, settings.local_error, longest)


@inner_kernel
def leads_away(run, m, t, longest):
    """Return a kink that a motion leaves from its start in either state, or -1. The drift jumps
    there, and the motion is not unique."""
    programs = run.programs
    x = run.motion.x
    D = run.work.D
    p = run.settings.order
    d = run.motion.mode.size
    watches = run.motion.armed.size
    found = np.int64(-1)
    for k in range(programs.kinks.state.size):
        row = programs.outs[m, x.size + d + 2 * k]
        band = rounding_band(run.work.G, d + k, t, x, KINK_BAND)
        if row < 0 or programs.kinks.spans[k, 1] > 1:
            continue
        both = True
        for _ in range(2):
            h = expand_motion(programs, m, t, x, run.settings, watches, longest, D)
            both = both and h > 0.0 and abs(D[row, 0]) <= band and D[row, 1] > 0.0
            both = both and lift_time(D, row, p, h, band) > 0.0
            cross_kink(programs, 2 * k)
        if both and found < 0:
            found = k
    return found


@inner_kernel
def settle_kinks(run, m, held, t, longest):
    """Set the states of the kinks in which the motion goes on from time t in program m.

    Returns SETTLED, UNCERTAIN, or a kink whose both sides lead to it. held: kink that was just
    reached, or -1. longest: longest step.
    """
    programs = run.programs
    x = run.motion.x
    d = run.motion.mode.size
    n = x.size
    V = run.work.V
    G = run.work.G
    D = run.work.D
    count = programs.kinks.state.size
    place_kinks(programs, d, held, t, x, V, G)
    result = SETTLED
    for changes in range(2 * count + 2 if count > 0 else 0):
        evaluate_program(programs, m, t, x, V)
        near = False
        for w in range(2 * count):
            row = programs.outs[m, n + d + w]
            band = kink_band(run, w, held, t)
            near = near or (row >= 0 and not V[row, 0] > band)
        if not near:
            result = SETTLED
            break
        h = expand_motion(programs, m, t, x, run.settings, run.motion.armed.size, longest, D)
        w = _falling_kink(run, m, held, t, h) if h > 0.0 else UNCERTAIN
        if w < 0:
            result = w
            break
        result = w // 2
        if changes <= 2 * count:
            cross_kink(programs, w)
    return result
