"""Take one step of an arc as a Taylor series: length, first event, samples, restart of the series.

The length keeps the highest terms of the series small (Jorba & Zou 2005) and every hard particle
within the certificate of the candidates. At the end of a step the state is projected onto the
active contacts and the slope of the series is compared with the equation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from nsbench.compilation.decorators import inlined, inner_kernel, one
from nsbench.dynamics.contacts.kernels.contact_arrays import ROW
from nsbench.solvers.event_driven.contacts.kernels.active_set_change import start_series
from nsbench.solvers.event_driven.contacts.kernels.first_event import (
    EventLevels,
    displacement_bound,
    first_event,
    leaves_list_certificate,
)
from nsbench.solvers.event_driven.contacts.kernels.held_set import LEAST_PIVOT
from nsbench.solvers.event_driven.contacts.kernels.loop_state import LoopCode
from nsbench.solvers.event_driven.contacts.kernels.taylor_flow import (
    all_entries,
    evaluate_gaps,
    evaluate_series,
    extend_series,
    max_difference,
    project_and_factor,
    size,
    step_length,
)
from nsbench.solvers.event_driven.contacts.kernels.traced_drift import certified_length

if TYPE_CHECKING:
    from nsbench.dynamics.contacts.kernels.contact_arrays import Contacts
    from nsbench.solvers.event_driven.contacts.kernels.held_set import HeldSet
    from nsbench.solvers.event_driven.contacts.kernels.loop_state import (
        Accumulated,
        ContactProblem,
        LoopCounters,
        LoopFloats,
        LoopSettings,
        LoopState,
        SampleRecord,
        Scratch,
        Series,
    )

# Local errors by which the slope at the end of a step may miss the equation: it is one order lower.
MAX_DEFECT = 1e3
SLOPE_ROUNDING = 1e-10  # part of the slope that ill-conditioned contacts lose by rounding
# Part of the tolerance that a step may miss of a traced drift, as in the Filippov loop.
DRIFT_SHARE = 0.03
MAX_HALVINGS = 60  # of a step that may leave the certificate of the candidates


@inner_kernel
def _evaluate_path(s, deg, X, F, out, push):
    """Evaluate the state, and the reaction since the start of the step, at s."""
    # displacement less the integral of the drift is the integral of the contact forces
    evaluate_series(X, deg, s, out)
    for i in range(out.size):
        total = 0.0
        for j in range(deg - 1, -1, -1):
            total = total * s + F[j, i] / (j + 1)
        push[i] = out[i] - X[0, i] - total * s


@inner_kernel
def _evaluate_rate(s, deg, X, out):
    """Evaluate the time derivative of the series of the state at s; out (n,)."""
    for i in range(out.size):
        out[i] = deg * X[deg, i]
    for j in range(deg - 1, 0, -1):
        for i in range(out.size):
            out[i] = out[i] * s + j * X[j, i]


@inner_kernel
def _integrate_multiplier(a, s, deg, mu):
    """Return the integral of mu[a] from the start of the step to s."""
    total = 0.0
    for j in range(deg - 1, -1, -1):
        total = total * s + mu[a, j] / (j + 1)
    return total * s


@inlined
def advance(
    s: float,
    t: float,
    deg: int,
    active: np.ndarray,
    held: HeldSet,
    contacts: Contacts,
    series: Series,
    x: np.ndarray,
    samples: SampleRecord,
    accumulated: Accumulated,
    counters: LoopCounters,
) -> None:
    """Record the samples up to t, at s in the step; move x and the integrals there.

    active (p,): entries; x (n,): written, the state at t. t, s: absolute and since the start of the
    step.
    """
    X = series.state
    F = series.drift
    column, total, reaction = accumulated
    kind = contacts.kind
    sign = contacts.sign
    mu = held.mu
    times = samples.time
    push = np.empty(x.size)
    t0 = t - s
    # Dense output: every sample is read off the series, none cuts a step.
    while counters.sample[0] < times.size and times[counters.sample[0]] <= t:
        r = counters.sample[0]
        u = min(times[r] - t0, s)
        _evaluate_path(u, deg, X, F, samples.state[r], push)
        for i in range(x.size):
            samples.reaction[r, i] = reaction[i] + push[i]
        for c in range(counters.columns[0]):
            samples.impulse[r, c] = total[c]
        for a in range(active.size):
            k = active[a]
            orientation = sign[k] if kind[k] != ROW else 1.0
            samples.impulse[r, column[k]] += orientation * _integrate_multiplier(a, u, deg, mu)
        counters.sample[0] += 1
    _evaluate_path(s, deg, X, F, x, push)
    for i in range(x.size):
        reaction[i] += push[i]
    for a in range(active.size):
        k = active[a]
        orientation = sign[k] if kind[k] != ROW else 1.0
        total[column[k]] += orientation * _integrate_multiplier(a, s, deg, mu)


@inlined
def _moves_time(h, settings, floats):
    """Check that a step is beyond rounding of the time, or leads to the end."""
    t = floats.time[0]
    return h > 4e-16 * (abs(t) + abs(settings.end)) or h >= settings.end - t


@inlined
def _choose_step(deg, active, held, series, x, bound, problem, settings, floats):
    """Return (h, code): the step that the series of this degree allows.

    code is REBUILD if the candidates must be rebuilt first, FAIL if there is no step, else DONE.
    bound (n,): written, displacement within h.
    """
    X = series.state
    remaining = settings.end - floats.time[0]
    h = min(
        min(step_length(X, held.mu, deg, settings.step_error, active), settings.max_step),
        remaining,
    )
    if not _moves_time(h, settings, floats):
        return h, LoopCode.FAIL
    # Halve the step until no hard particle can leave the certificate of the candidates.
    for _ in range(MAX_HALVINGS):
        displacement_bound(X, deg, h, one(), bound)
        if settings.reach == np.inf:
            return h, LoopCode.DONE
        may, did = leaves_list_certificate(
            x, problem.list_centre, bound, problem.hard, 0.5 * settings.reach
        )
        if not may:
            return h, LoopCode.DONE
        if did:
            return h, LoopCode.REBUILD
        h *= 0.5
    return h, LoopCode.FAIL


@inlined
def arm_events(
    active: np.ndarray,
    held: HeldSet,
    problem: ContactProblem,
    x: np.ndarray,
    settings: LoopSettings,
    floats: LoopFloats,
) -> EventLevels:
    """Return the EventLevels of gaps and multipliers at the start of an arc at x (n,)."""
    contacts = problem.contacts
    norm = problem.norm
    m = norm.size
    near = settings.tol * (settings.length + size(x))
    band = np.empty(m)
    level = np.empty(m)
    armed = np.empty(m, np.bool_)
    g = np.empty(m)
    evaluate_gaps(all_entries(m), contacts, problem.layout, x, g)
    for k in range(m):
        band[k] = near * norm[k]
        armed[k] = g[k] > band[k]
        level[k] = 0.0 if armed[k] else min(g[k], 0.0) - band[k]
    # the same for the multipliers, in units of the largest drift so far
    firm = np.empty(active.size, np.bool_)
    low = np.empty(active.size)
    kind = contacts.kind
    sign = contacts.sign
    mu = held.mu
    for a in range(active.size):
        k = active[a]
        lam = mu[a, 0] * (sign[k] if kind[k] != ROW else 1.0)
        tight = settings.tol * floats.drift_size[0] / norm[k]
        firm[a] = lam > tight
        low[a] = min(lam, 0.0) - tight
    return EventLevels(band, level, armed, firm, low)


@inlined
def _locate_event(deg, h, active, held, is_active, problem, series, levels, bend, settings, floats):
    """Return (s, entry, touches, EventLevels at the end): the first event within h, at s h."""
    later = EventLevels(
        levels.gap_band,
        levels.gap_level,
        levels.gap_armed.copy(),
        levels.multiplier_armed.copy(),
        levels.multiplier_level,
    )
    displacement_bound(series.state, deg, h, 2 * one(), bend)
    s, entry, touches = first_event(
        active,
        is_active,
        problem.contacts,
        problem.layout,
        problem.norm,
        series.state,
        held.mu,
        deg,
        h,
        later,
        settings.tol * floats.drift_size[0],
        bend,
    )
    return s, entry, touches, later


@inlined
def try_step(
    deg: int,
    quick: int,
    active: np.ndarray,
    held: HeldSet,
    is_active: np.ndarray,
    problem: ContactProblem,
    series: Series,
    levels: EventLevels,
    x: np.ndarray,
    bound: np.ndarray,
    loop: LoopState,
) -> tuple[LoopCode, int, float, float, int, int, EventLevels]:
    """Extend the series, choose the step and locate its first event.

    A series of order `quick` is enough if an event ends the step; else it is extended to the full
    order. x (n,): the state at the start; bound (n,): work.
    Returns (code, deg, h, s, entry, touches, EventLevels at the end of the step).
    """
    settings, floats, counters = loop
    h = 0.0
    s = 2.0
    entry = -one()
    touches = 0
    later = levels
    # first a short series, which is enough where an event is near
    for goal in (quick, problem.order):
        if goal <= deg:
            continue
        extend_series(
            deg,
            goal,
            floats.time[0],
            active,
            held,
            problem.contacts,
            problem.drift,
            problem.program,
            series.state,
            series.drift,
        )
        counters.orders[0] += goal - deg
        deg = goal
        h, code = _choose_step(deg, active, held, series, x, bound, problem, settings, floats)
        if code != LoopCode.DONE:
            return code, deg, h, s, entry, touches, later
        if problem.program.out.size > 0:
            local = DRIFT_SHARE * settings.tol * settings.length
            h = certified_length(h, deg, floats.time[0], local, problem.program, series.state)
            if not _moves_time(h, settings, floats):
                return LoopCode.FAIL, deg, h, s, entry, touches, later
        s, entry, touches, later = _locate_event(
            deg, h, active, held, is_active, problem, series, levels, bound, settings, floats
        )
        if entry >= 0 or h >= settings.end - floats.time[0]:
            break
    return LoopCode.DONE, deg, h, s, entry, touches, later


@inlined
def restart_series(
    h: float,
    s: float,
    deg: int,
    active: np.ndarray,
    held: HeldSet,
    problem: ContactProblem,
    series: Series,
    x: np.ndarray,
    scratch: Scratch,
    loop: LoopState,
) -> bool:
    """Project x (n,), start a new series there and compare the slopes of both at the end of the
    step.

    Returns False if the old series missed the slope by more than its error: the path does something
    that the series does not show.
    """
    settings, floats, _ = loop
    X = series.state
    rate = scratch.vector
    _evaluate_rate(s, deg, X, rate)
    if not project_and_factor(
        active,
        held,
        problem.contacts,
        problem.layout,
        problem.norm,
        x,
        scratch.zeros,
        LEAST_PIVOT,
        settings.length,
    ):
        return False
    start_series(active, held, problem, series, floats.time[0], x)
    defect = h * max_difference(rate, X[1])
    allowed = settings.step_error * MAX_DEFECT * (1.0 + size(x)) + SLOPE_ROUNDING * h * size(rate)
    return defect <= allowed
