"""Choose, in compiled code, the mode that continues at one switching surface, where it is certain.

The host's search among all modes is event_driven.filippov.mode_search.

The last of the programs (see loop_state.Programs) computes value, gradient and time derivative of
every switch function c_i and of the arguments of kinks. Conditions, bands and trial motions are
those of event_driven.filippov.mode_search, in which the host decides what is not certain here.
"""

import numpy as np

from nsbench.compilation.decorators import fused_kernel, inlined, inner_kernel, njit
from nsbench.solvers.event_driven.filippov.kernels.step_certificate import step_length
from nsbench.solvers.event_driven.filippov.kernels.taylor_series import horner, point, series

EPS = 2.0**-52
UNKNOWN = 9  # result of `choose_mode`: not certain
NO_SURFACE = -1  # results of `surface_met`
SEVERAL_SURFACES = -2
FLAT = 1e-7  # relative size below which a first derivative decides nothing
NEAR_SURFACE = 1e3  # roundings of c_i within which a point counts as on the surface
TRIAL_ORDER = 12  # largest order of a trial: it goes no further than a thousandth of the run
# lengths of a trial: powers of ten of the length of the run, from the first to before the last
FIRST_TRIAL = -7
AFTER_TRIALS = -2
LONGEST_TRIAL = 1e-3
SAME_FIELD = 1e-14  # relative difference of fields below which they are equal
PROJECTIONS = 3  # Newton steps onto a surface: quadratic, from a state that is almost on it


@fused_kernel
def program_of_mode(table, mode):
    """Return the number of the program of a mode, -1 if it has none."""
    k = 0
    base = 1
    for i in range(mode.size):
        if mode[i] < -1 or mode[i] > 1:
            return -1
        k += base * (mode[i] + 1)
        base *= 3
    return table[k]


@njit(cache=True, error_model="numpy", forceinline=True)
def evaluate_program(programs, m, t, x, V):
    """Fill V[:, 0] with the values of program m at the point (t, x)."""
    n = x.size
    for i in range(n):
        V[i, 0] = x[i]
    V[n, 0] = t
    point(programs.ops, programs.nums, programs.first[m], n, V, 1)


@fused_kernel
def evaluate_geometry(programs, t, x, V, G):
    """Fill G (d + K, n + 2): gradient, time derivative and value of each switch function, then of
    each argument of a kink."""
    m = programs.outs.shape[0] - 1
    n = x.size
    evaluate_program(programs, m, t, x, V)
    for i in range(G.shape[0]):
        for j in range(n + 2):
            G[i, j] = V[programs.outs[m, i * (n + 2) + j], 0]


@inner_kernel
def rounding_band(G, i, t, x, times):
    """Return what rounding leaves of c_i on its surface: `times` roundings of the terms of c_i."""
    n = x.size
    s = 0.0
    for j in range(n):
        s += abs(G[i, j]) * (1.0 + abs(x[j]))
    return times * EPS * (s + abs(G[i, n]) * (1.0 + abs(t)))


@fused_kernel
def project_onto_surface(programs, i, t, x, V, G):
    """Move x to c_i = 0 along the gradient, in place (Newton's method)."""
    n = x.size
    for _ in range(PROJECTIONS):
        evaluate_geometry(programs, t, x, V, G)
        size = 0.0
        square = 0.0
        for j in range(n):
            size += abs(G[i, j] * x[j])
            square += G[i, j] * G[i, j]
        if abs(G[i, n + 1]) <= 4.0 * EPS * size or not 0.0 < square < np.inf:
            return
        for j in range(n):
            x[j] -= G[i, j] * G[i, n + 1] / square


@inner_kernel
def trial_sign(programs, m, i, slides, watches, t, x, settings, least, C):
    """Return the sign that the watched function of surface i shows first on a trial motion in
    program m; 0 if it shows none, or not the same one later on.

    slides: whether program m slides on surface i, which is watched from both ends then. watches:
    number of watched functions, the last one of the weight. least: size above which a sign is one.
    C: work, as Workspace.D.
    """
    n = x.size
    outs = programs.outs[m]
    p = min(settings.order, TRIAL_ORDER)
    for j in range(n):
        C[j, 0] = x[j]
    C[n, 0] = t
    series(programs.ops, programs.nums, programs.first[m], outs, n, p, C)
    longest = step_length(
        C, n, p, x, outs, watches, settings.local_error, LONGEST_TRIAL * settings.span
    )
    found = 0
    for k in range(FIRST_TRIAL, AFTER_TRIALS):
        h = settings.span * 10.0**k
        if h > 1.001 * longest:
            break
        v = horner(C, outs[n + i], h, p)
        if slides:
            v = min(v, horner(C, outs[n + watches - 1], h, p))
        if not np.isfinite(v):
            return 0
        if abs(v) > least:
            sign = 1 if v > 0.0 else -1
            if found == 0:
                found = sign
            elif found != sign:
                return 0
    return found


@inlined
def _side_rates(programs, modes, i, t, x, mode, work, rate):
    """Fill rate (2,) with dc_i/dt in the fields of the positive and the negative side of surface i,
    work.F with these fields; return the larger rate, 0 if the two decide nothing."""
    n = x.size
    V = work.V
    G = work.G
    F = work.F
    for k in range(2):
        mode[i] = 1 - 2 * k
        m = program_of_mode(modes.table, mode)
        if m < 0:
            return 0.0
        evaluate_program(programs, m, t, x, V)
        rate[k] = G[i, n]
        for j in range(n):
            F[k, j] = V[programs.outs[m, j], 0]
            rate[k] += G[i, j] * F[k, j]
    size = max(abs(rate[0]), abs(rate[1]))
    apart = 0.0
    most = 0.0
    for j in range(n):
        apart = max(apart, abs(F[0, j] - F[1, j]))
        most = max(most, abs(F[0, j]), abs(F[1, j]))
    if not (np.isfinite(size) and np.isfinite(most)) or apart <= 2.0 * SAME_FIELD * most:
        return 0.0
    return size


@inner_kernel
def choose_mode(programs, modes, i, t, x, mode, settings, work):
    """Return the mode of surface i that continues from (t, x) if exactly one does and that is
    certain, else UNKNOWN.

    mode (d,): its entry i is overwritten; the others are +-1.
    """
    n = x.size
    rate = np.zeros(2)
    evaluate_geometry(programs, t, x, work.V, work.G)
    wide = rounding_band(work.G, i, t, x, NEAR_SURFACE)
    size = _side_rates(programs, modes, i, t, x, mode, work, rate)
    if size == 0.0:
        return UNKNOWN
    continues = UNKNOWN
    # Filippov's conditions: to slide the weight must lie in [0, 1], to leave the rate must point
    # away; where the first derivative vanishes a trial motion decides
    for q in (0, 1, -1):
        gap = rate[1] - rate[0]
        if q == 0:
            value = 1.0 - abs((rate[0] + rate[1]) / gap) if gap != 0.0 else -1.0
        else:
            value = rate[0] / size if q == 1 else -rate[1] / size
        if value < -FLAT:
            continue
        mode[i] = q
        if value <= FLAT:
            m = program_of_mode(modes.table, mode)
            if m < 0:
                return UNKNOWN
            for j in range(n):
                work.y[j] = x[j]
            if q == 0:
                project_onto_surface(programs, i, t, work.y, work.V, work.G)
            least = 1e-2 * FLAT if q == 0 else wide / 10
            watches = work.band.size
            sign = trial_sign(programs, m, i, q == 0, watches, t, work.y, settings, least, work.D)
            if sign == 0:
                return UNKNOWN
            if sign < 0:
                continue
        if continues != UNKNOWN:
            return UNKNOWN
        continues = q
    return continues


@inlined
def surface_met(programs, t, x, mode, before, V, G):
    """Return the only surface that (t, x) is on, NO_SURFACE for none, SEVERAL_SURFACES for several.

    before: the surface of an event; -1 at the start, where mode is set to the signs of the switch
    functions.
    """
    n = x.size
    evaluate_geometry(programs, t, x, V, G)
    which = before
    for k in range(mode.size):
        if before < 0:
            mode[k] = 1 if G[k, n + 1] > 0.0 else -1
        near = not abs(G[k, n + 1]) > rounding_band(G, k, t, x, NEAR_SURFACE)
        if k != before and (mode[k] == 0 or near):
            which = k if which == NO_SURFACE else SEVERAL_SURFACES
    return which
