"""Where a Filippov motion meets a surface: the geometry there, and which mode continues, decided
where that is plain.

ops, nums, first, outs: the programs of the modes
(nsbench.solvers.event_driven.filippov.tracing.layout); the last program is the geometry of the
surfaces.
"""

import numpy as np

from nsbench.compilation.decorators import njit
from nsbench.solvers.event_driven.filippov.kernels.certified_step import length
from nsbench.solvers.event_driven.filippov.kernels.taylor_series import horner, inner, point, series

EPS = 2.0**-52
UNKNOWN = 9  # `decide`: not plain
# as in solvers._switching
FLAT = 1e-7
AWAY_BAND = 1e3
SHORT = 12  # largest order of a trial: it goes no further than a thousandth of the run
SAME = 1e-14  # as in solvers._sliding


@inner
def program(table, mode):
    """Number of the program of a mode; -1: none."""
    k = 0
    base = 1
    for i in range(mode.size):
        if mode[i] < -1 or mode[i] > 1:
            return -1
        k += base * (mode[i] + 1)
        base *= 3
    return table[k]


@njit(cache=True, error_model="numpy")
def at(ops, nums, first, outs, m, n, t, x, V):
    """Values of program m at a point."""
    for i in range(n):
        V[i, 0] = x[i]
    V[n, 0] = t
    point(ops, nums, first[m, 0], first[m, 2], n, V, 1)


@inner
def geometry(ops, nums, first, outs, n, d, t, x, V, G):
    """G (d, n + 2): gradient, time derivative and value of each switch function (the last
    program)."""
    m = outs.shape[0] - 1
    at(ops, nums, first, outs, m, n, t, x, V)
    for i in range(d):
        for j in range(n + 2):
            G[i, j] = V[outs[m, i * (n + 2) + j], 0]


@inner
def band(G, i, t, x, times):
    """What rounding leaves of c_i on its surface (see solvers._switching)."""
    n = x.size
    s = 0.0
    for j in range(n):
        s += abs(G[i, j]) * (1.0 + abs(x[j]))
    return times * EPS * (s + abs(G[i, n]) * (1.0 + abs(t)))


@inner
def project(ops, nums, first, outs, n, d, i, t, x, V, G):
    """Move x to c_i = 0 along the gradient (see solvers._sliding)."""
    for _ in range(3):
        geometry(ops, nums, first, outs, n, d, t, x, V, G)
        size = 0.0
        square = 0.0
        for j in range(n):
            size += abs(G[i, j] * x[j])
            square += G[i, j] * G[i, j]
        if abs(G[i, n + 1]) <= 4.0 * EPS * size or not 0.0 < square < np.inf:
            return
        for j in range(n):
            x[j] -= G[i, j] * G[i, n + 1] / square


@inner
def trial(ops, nums, first, outs, n, d, p, m, i, slides, t, x, span, local, least, C):
    """Sign that the watched function of surface i shows first on a trial in program m; 0: none, or
    not the same later on."""
    p = min(p, SHORT)
    for j in range(n):
        C[j, 0] = x[j]
    C[n, 0] = t
    series(ops, nums, first[m, 0], first[m, 1], first[m, 2], outs[m], n, p, C)
    most = length(C, n, p, x, outs[m], d + 1, local, 1e-3 * span)
    seen = 0
    for k in range(-7, -2):
        h = span * 10.0**k
        if h > 1.001 * most:
            break
        v = horner(C, outs[m, n + i], h, p)
        if slides:
            v = min(v, horner(C, outs[m, n + d], h, p))
        if not np.isfinite(v):
            return 0
        if abs(v) > least:
            sign = 1 if v > 0.0 else -1
            if seen == 0:
                seen = sign
            elif seen != sign:
                return 0
    return seen


@inner
def choose_mode(ops, nums, first, outs, table, n, d, p, i, mode, t, x, span, local, V, G, F, C, y):
    """The mode of surface i that continues from (t, x), if it is the only one and that is plain;
    else UNKNOWN.

    F (2, n), y (n,), mode (d,): scratch; the other entries of mode are +-1.
    """
    rate = np.zeros(2)
    geometry(ops, nums, first, outs, n, d, t, x, V, G)
    wide = band(G, i, t, x, AWAY_BAND)
    for k in range(2):
        mode[i] = 1 - 2 * k
        m = program(table, mode)
        if m < 0:
            return UNKNOWN
        at(ops, nums, first, outs, m, n, t, x, V)
        rate[k] = G[i, n]
        for j in range(n):
            F[k, j] = V[outs[m, j], 0]
            rate[k] += G[i, j] * F[k, j]
    size = max(abs(rate[0]), abs(rate[1]))
    apart = 0.0
    most = 0.0
    for j in range(n):
        apart = max(apart, abs(F[0, j] - F[1, j]))
        most = max(most, abs(F[0, j]), abs(F[1, j]))
    if not (np.isfinite(size) and np.isfinite(most)) or size == 0.0 or apart <= 2.0 * SAME * most:
        return UNKNOWN
    good = UNKNOWN
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
            m = program(table, mode)
            if m < 0:
                return UNKNOWN
            for j in range(n):
                y[j] = x[j]
            if q == 0:
                project(ops, nums, first, outs, n, d, i, t, y, V, G)
            least = 1e-2 * FLAT if q == 0 else wide / 10
            sign = trial(ops, nums, first, outs, n, d, p, m, i, q == 0, t, y, span, local, least, C)
            if sign == 0:
                return UNKNOWN
            if sign < 0:
                continue
        if good != UNKNOWN:
            return UNKNOWN
        good = q
    return good


@inner
def surface_met(ops, nums, first, outs, n, d, t, x, mode, before, V, G):
    """Which surface is met, the only one near: -1 for none, -2 for several. before: surface of an
    event, -1 at the start, where the mode is set to the signs of the switch functions."""
    geometry(ops, nums, first, outs, n, d, t, x, V, G)
    which = before
    for k in range(d):
        if before < 0:
            mode[k] = 1 if G[k, n + 1] > 0.0 else -1
        if k != before and (mode[k] == 0 or not abs(G[k, n + 1]) > band(G, k, t, x, AWAY_BAND)):
            which = k if which == -1 else -2
    return which
