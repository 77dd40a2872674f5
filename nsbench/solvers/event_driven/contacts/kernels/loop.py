"""Integrate between events in compiled code, for constraints at rest.

Arcs are Taylor series (see taylor_flow and series_step) and events are isolated descents of
polynomials (see first_event). The next active set is chosen here where it is certain (see
active_set_change); elsewhere the loop returns, and the driver solves the complementarity problem
with look-ahead. The loop also returns where it fails: then the driver starts again in Python.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from nsbench.compilation.borrowed_arrays import borrowed
from nsbench.compilation.decorators import inlined, njit, one
from nsbench.dynamics.contacts.kernels.contact_arrays import ROW
from nsbench.solvers.event_driven.contacts.kernels.active_set_change import (
    ACTIVE,
    DEPENDENT,
    NEW,
    hold_active,
    next_active_set,
    start_series,
)
from nsbench.solvers.event_driven.contacts.kernels.loop_state import (
    CONTACT,
    FIRST,
    PIVOT,
    RELEASE,
    ArcEnd,
    LoopCode,
    Scratch,
    Series,
)
from nsbench.solvers.event_driven.contacts.kernels.series_step import (
    advance,
    arm_events,
    restart_series,
    try_step,
)
from nsbench.solvers.event_driven.contacts.kernels.taylor_flow import (
    copy_into,
    size,
    sorted_index,
)

if TYPE_CHECKING:
    from nsbench.solvers.event_driven.contacts.kernels.loop_state import (
        Accumulated,
        ContactProblem,
        EventLog,
        LoopState,
        SampleRecord,
    )

SHORT_ORDER = 10  # of a series where the next event is expected soon
# Steps still to take beyond which the equation is stiff and another method is better; a traced
# drift may be steep for a short time, and is left only after so many steps of an arc.
MAX_REMAINING_STEPS = 50_000
STIFF_STEPS = 4000


@inlined
def _assign_columns(active, column, counters):
    """Give every active entry that never acted before a column of the impulses."""
    for k in active:
        if column[k] < 0:
            column[k] = counters.columns[0]
            counters.columns[0] += 1


@inlined
def _log_events(role, is_active, is_closed, log, loop):
    """Log what closed, opened, or lost its multiplier to others; update both masks.

    Returns False if the log is full.
    """
    _, floats, counters = loop
    # Contacts first, then releases, then exchanges: the order of the log within one instant.
    first = FIRST
    for kind in (CONTACT, RELEASE, PIVOT):
        for k in range(role.size):
            what = role[k] % NEW
            new = role[k] >= NEW
            after = what >= DEPENDENT
            if (
                (kind == CONTACT and new and after)
                or (kind == RELEASE and is_closed[k] and not new and not after)
                or (kind == PIVOT and not new and is_active[k] and what == DEPENDENT)
            ):
                e = counters.events[0]
                log.time[e] = floats.time[0]
                log.kind[e] = kind + first
                log.entry[e] = k
                counters.events[0] = e + 1
                first = 0
                if counters.events[0] == log.time.size:
                    return False
    for k in range(role.size):
        is_active[k] = role[k] % NEW == ACTIVE
        is_closed[k] = role[k] % NEW >= DEPENDENT
    counters.active_sets[0] += 1
    total = 0
    for k in range(role.size):
        total += is_closed[k]
    counters.max_closed[0] = max(counters.max_closed[0], total)
    return True


@inlined
def _active_entries(is_active):
    """Return the active entries, ascending."""
    active = np.empty(is_active.size, np.int64)
    p = 0
    for k in range(is_active.size):
        if is_active[k]:
            active[p] = k
            p += 1
    return active[:p]


@inlined
def _end_arc(entry, s, deg, active, held, is_active, contacts, counters):
    """Count an arc and return the ArcEnd of the event at s in its last step."""
    closing = not is_active[entry]
    counters.recent_steps[0] += 1
    counters.arcs[0] += 1
    counters.closing_entry[0] = entry if closing else -1
    counters.event_entry[0] = entry
    slope = 0.0
    if not closing:
        a = sorted_index(active, entry)
        mu = held.mu
        # Horner's rule for the derivative of the series of the multiplier
        for j in range(deg - 1, 0, -1):
            slope = slope * s + j * mu[a, j]
        slope *= contacts.sign[entry] if contacts.kind[entry] != ROW else 1.0
    return ArcEnd(entry, closing, slope)


@inlined
def _follow_arc(
    active, held, is_active, problem, x, series, quick, samples, accumulated, scratch, loop
):
    """Step along one arc to its first event or to the end of the run.

    Returns (code, entry, s, deg, quick, longest step): code PAUSE means that an event was reached,
    at s in the last step; any other code ends the call.
    """
    settings, floats, counters = loop
    # Taylor steps: each is cut at its first event, else the series starts anew at its end.
    levels = arm_events(active, held, problem, x, settings, floats)
    longest = 0.0
    taken = 0
    entry = -one()
    s = 0.0
    deg = one()
    while entry < 0:
        if counters.steps[0] >= settings.max_steps or not size(x) <= settings.box:
            return LoopCode.FAIL, entry, s, deg, quick, longest
        code, deg, h, s, entry, touches, later = try_step(
            deg, quick, active, held, is_active, problem, series, levels, x, scratch.bound, loop
        )
        if code != LoopCode.DONE:
            return code, entry, s, deg, quick, longest
        counters.steps[0] += 1
        taken += 1
        levels = later
        counters.touches[0] += touches if entry < 0 else 0
        floats.longest_step[0] = max(floats.longest_step[0], h)
        longest = max(longest, h)
        remaining = settings.end - floats.time[0]
        settled = problem.program.out.size == 0 or taken > STIFF_STEPS
        if entry < 0 and settled and remaining > MAX_REMAINING_STEPS * h:
            return LoopCode.FAIL, entry, s, deg, quick, longest
        quick = problem.order if entry < 0 else SHORT_ORDER
        last = entry < 0 and h >= remaining
        s = h if entry < 0 else s * h
        floats.time[0] = settings.end if last else floats.time[0] + s
        advance(
            s,
            floats.time[0],
            deg,
            active,
            held,
            problem.contacts,
            series,
            x,
            samples,
            accumulated,
            counters,
        )
        if last:
            return LoopCode.DONE, entry, s, deg, quick, longest
        if entry < 0:
            if not restart_series(h, s, deg, active, held, problem, series, x, scratch, loop):
                return LoopCode.FAIL, entry, s, deg, quick, longest
            deg = one()
    return LoopCode.PAUSE, entry, s, deg, quick, longest


@njit(cache=True, error_model="numpy")
def integrate_contacts(
    problem: ContactProblem,
    x: np.ndarray,
    is_active: np.ndarray,
    is_closed: np.ndarray,
    samples: SampleRecord,
    accumulated: Accumulated,
    recent_steps: np.ndarray,
    log: EventLog,
    loop: LoopState,
) -> LoopCode:
    """Integrate with the active set until the driver must decide; return a LoopCode.

    problem: ContactProblem. x (n,): state, written. is_active, is_closed (m,): masks of the
    candidates, written. samples: SampleRecord; accumulated: Accumulated; recent_steps: ring of the
    largest step of each arc; log: EventLog; loop: LoopState; all written.
    """
    problem = borrowed(problem)
    samples = borrowed(samples)
    accumulated = borrowed(accumulated)
    log = borrowed(log)
    loop = borrowed(loop)
    counters = loop.counters
    n = x.size
    series = Series(np.empty((problem.order + 1, n)), np.empty((problem.order, n)))
    scratch = Scratch(np.empty(n), np.empty(n), np.zeros(n))
    saved = scratch.vector
    work = scratch.zeros
    active = _active_entries(is_active)
    good, held = hold_active(active, problem, x, work, loop.settings.length)
    has_velocity = False
    quick = SHORT_ORDER
    # Event-driven integration: arc, event, next active set. Each pass follows one arc.
    while good:
        _assign_columns(active, accumulated.column, counters)
        if not has_velocity:
            start_series(active, held, problem, series, loop.floats.time[0], x)
        has_velocity = True
        code, entry, s, deg, quick, longest = _follow_arc(
            active, held, is_active, problem, x, series, quick, samples, accumulated, scratch, loop
        )
        if code != LoopCode.PAUSE:
            return code
        recent_steps[counters.recent_steps[0] % recent_steps.size] = longest
        event = _end_arc(entry, s, deg, active, held, is_active, problem.contacts, counters)
        copy_into(x, saved)
        certain = not (event.closing and is_closed[entry])
        if certain:
            certain, active, held, role = next_active_set(
                event, active, held, is_closed, problem, x, series, work, loop, size(recent_steps)
            )
        if not certain:
            copy_into(saved, x)
            return LoopCode.CHOOSE
        if not _log_events(role, is_active, is_closed, log, loop):
            return LoopCode.FAIL
        if counters.events[0] > log.time.size // 2:
            return LoopCode.PAUSE
    return LoopCode.FAIL
