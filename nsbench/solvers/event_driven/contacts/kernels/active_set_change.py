"""Find the active set after one event where it is certain; decide nothing elsewhere.

The search starts from the active set before the event, with the contact that closed or without the
one whose multiplier vanished. A member whose multiplier is negative leaves: a closed contact that
depends on the set through it takes its place if its own multiplier is then positive; else both
open.
A contact that still closes enters. The set is accepted if every multiplier is strictly positive and
every other closed contact opens strictly or depends on the set: then it solves the complementarity
problem of velocities, whose velocity is unique (Lawson & Hanson 1974, chapter 23), on whatever path
it was found.

Each candidate has a role during the search: OPEN, LEAVING (its gap opens with this event),
DEPENDENT (closed, in the span of the active ones, without a multiplier) or ACTIVE. NEW is added
where the contact closed with this event.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from nsbench.compilation.decorators import inlined, inner_kernel, one
from nsbench.dynamics.contacts.kernels.contact_arrays import ROW
from nsbench.solvers.event_driven.contacts.kernels.held_set import (
    build_held_set,
    gap_rate,
    inverse_column,
    squared_sine_to_span,
    toggled,
)
from nsbench.solvers.event_driven.contacts.kernels.taylor_flow import (
    all_entries,
    copy_into,
    evaluate_gaps,
    extend_series,
    size,
    sorted_index,
)

if TYPE_CHECKING:
    from nsbench.solvers.event_driven.contacts.kernels.held_set import HeldSet
    from nsbench.solvers.event_driven.contacts.kernels.loop_state import (
        ArcEnd,
        ContactProblem,
        LoopState,
        Series,
    )

MAX_SET_CHANGES = 24  # after one event: beyond, the selection with look-ahead takes over
UNCERTAINTY = 1e2  # factor around the bound on dependence within which nothing is decided
# Part of a step of the integrator: the first look-ahead time, where slopes must be visible.
LOOK_AHEAD = 1e-5
# Roles of a candidate; NEW is added to those that closed with this event.
OPEN = 0
LEAVING = 1
DEPENDENT = 2
ACTIVE = 3
NEW = 4


@inlined
def _weakest_member(active, held, problem, small, rising):
    """Return the position of the smallest multiplier if it is not above `small`.

    -1 if all are above, -2 if one is not finite. rising: entry whose multiplier is zero now and
    grows, which may be small.
    """
    kind = problem.contacts.kind
    sign = problem.contacts.sign
    norm = problem.norm
    mu = held.mu
    # Multipliers times the length of the gradient are velocities, comparable among contacts.
    lowest = small
    which = -1
    for a in range(active.size):
        lam = (sign[active[a]] if kind[active[a]] != ROW else 1.0) * mu[a, 0] * norm[active[a]]
        if not np.isfinite(lam):
            return -2
        if lam <= lowest and (active[a] != rising or lam < -small):
            lowest = lam
            which = a
    return which


@inner_kernel
def _find_replacement(a, active, held, role, contacts, layout, x, dependent):
    """Find the dependent contact that replaces member a when it leaves.

    With z the column of the inverse Gram matrix, G_c G^T z is the coefficient of the member in row
    c. If it is negative, c carries what the member would have to pull; if all are positive they
    open with the member and get the role LEAVING.
    Returns (certain, entry of the replacement or -1, its coefficient, diagonal of the inverse Gram
    matrix).
    """
    k = active[a]
    pull, top = inverse_column(k, active, held, x.size)
    # Ratio test: the dependent contact with the most negative coefficient takes over.
    best = 0.0
    which = -1
    orientation = contacts.sign[k] if contacts.kind[k] != ROW else 1.0
    for c in range(role.size):
        if role[c] == DEPENDENT or role[c] == DEPENDENT + NEW:
            y, length = gap_rate(c, contacts, layout, x, pull)
            if y * y > dependent / UNCERTAINTY * length:
                if y * y < dependent * UNCERTAINTY * length:
                    return False, -1, 0.0, top
                if orientation * y < best:
                    best = orientation * y
                    which = c
    # No contact takes over: those that depend on the member open together with it.
    if which < 0:
        for c in range(role.size):
            if role[c] == DEPENDENT or role[c] == DEPENDENT + NEW:
                y, length = gap_rate(c, contacts, layout, x, pull)
                if y * y > dependent * UNCERTAINTY * length:
                    role[c] += LEAVING - DEPENDENT
    return True, which, best * np.sqrt(top), top


@inlined
def _closing_contact(role, entries, entry, problem, x, v, settings, floats):
    """Find a closed contact outside the active set that does not open strictly.

    entries: all entries. entry: one that opens from zero speed, which was checked before.
    Returns (entry, its speed); entry is -1 if there is none, -2 if that is uncertain.
    """
    near = settings.tol * (settings.length + size(x))
    small = settings.undecided * floats.drift_size[0]
    contacts = problem.contacts
    layout = problem.layout
    norm = problem.norm
    # Closed contacts, and those that left with this event, must open with a speed that is certain.
    g = np.empty(role.size)
    evaluate_gaps(entries, contacts, layout, x, g)
    for k in range(role.size):
        what = role[k] % NEW
        if what == ACTIVE or k == entry:
            continue
        if what == DEPENDENT:
            if g[k] > near * norm[k]:
                return -2, 0.0
        elif what == LEAVING or g[k] <= near * norm[k]:
            w, _ = gap_rate(k, contacts, layout, x, v)
            if not w > small * norm[k]:
                return (-2 if what == LEAVING else k), w / norm[k]
    return -1, 0.0


@inlined
def _initial_roles(active, is_closed):
    """Return the role of every candidate before the event, (m,)."""
    role = np.zeros(is_closed.size, np.int64)
    for k in range(is_closed.size):
        role[k] = DEPENDENT if is_closed[k] else OPEN
    for k in active:
        role[k] = ACTIVE
    return role


@inner_kernel
def _remove_member(a, active, which, role):
    """Return the set without member a, with the dependent entry `which` in its place unless -1."""
    k = active[a]
    active = toggled(active, k, -one())
    role[k] += (LEAVING if which < 0 else DEPENDENT) - ACTIVE
    if which >= 0:
        active = toggled(active, which, one())
        role[which] += ACTIVE - DEPENDENT
    return active


@inlined
def hold_active(
    active: np.ndarray, problem: ContactProblem, x: np.ndarray, work: np.ndarray, length: float
) -> tuple[bool, HeldSet]:
    """Factorise the active contacts (p,) and project x (n,) onto them; return (ok, HeldSet).

    work (n,): zeros. length: characteristic length of the case.
    """
    return build_held_set(
        active,
        problem.contacts,
        problem.layout,
        problem.norm,
        x,
        problem.width,
        problem.order,
        work,
        length,
    )


@inlined
def start_series(
    active: np.ndarray,
    held: HeldSet,
    problem: ContactProblem,
    series: Series,
    t: float,
    x: np.ndarray,
) -> None:
    """Start the series at (t, x (n,)): order 1 of the state, order 0 of the drift and of mu."""
    copy_into(x, series.state[0])
    extend_series(
        one() - 1,
        one(),
        t,
        active,
        held,
        problem.contacts,
        problem.drift,
        problem.program,
        series.state,
        series.drift,
    )


@inlined
def _solve_velocity(active, start, x, problem, series, work, settings, floats):
    """Project `start` onto the active set and compute its velocity there.

    x (n,): the projected state. series: order 1 of the state, order 0 of the drift and, in the
    HeldSet, of mu. Returns (ok, HeldSet); ok is False if the active contacts depend on each other.
    """
    copy_into(start, x)
    ok, held = hold_active(active, problem, x, work, settings.length)
    if ok:
        start_series(active, held, problem, series, floats.time[0], x)
        floats.drift_size[0] = max(floats.drift_size[0], size(series.drift[0]))
    return ok, held


@inlined
def _first_trial_set(event, active, held, role, problem, x, settings, floats, recent_step):
    """Return the first set to try after the event.

    Returns (certain, set, entry whose multiplier grows from zero or -1, entry whose gap opens from
    rest or -1).
    """
    entry, closing, slope = event
    if closing:
        role[entry] = ACTIVE + NEW
        return True, toggled(active, entry, one()), -1, -1
    # A multiplier vanished: its contact leaves, or a dependent one takes its place.
    a = sorted_index(active, entry)
    certain, which, c, top = _find_replacement(
        a, active, held, role, problem.contacts, problem.layout, x, settings.dependent
    )
    visible = UNCERTAINTY * settings.strict * floats.drift_size[0]
    active = _remove_member(a, active, which, role)
    if which >= 0:
        grows = slope / c * problem.norm[which] * LOOK_AHEAD * recent_step > visible
        return certain and grows, active, which, -1
    for k in range(role.size):
        if role[k] == LEAVING and k != entry:  # several open from rest: left to the look-ahead
            certain = False
    return certain and -slope / top * LOOK_AHEAD * recent_step > visible, active, -1, entry


@inlined
def _is_independent(entering, active, held, problem, x, velocity, settings):
    """Check that the entry that entered last is independent of the other active contacts."""
    _, top = inverse_column(entering, active, held, x.size)
    _, length = gap_rate(entering, problem.contacts, problem.layout, x, velocity)
    return 1.0 > UNCERTAINTY * settings.dependent * top * length


@inlined
def _is_dependent(entry, active, held, problem, x, settings):
    """Check that a gradient lies in the span of the active contacts beyond doubt."""
    sine = squared_sine_to_span(entry, active, held, problem.contacts, problem.layout, x)
    return sine < settings.dependent / UNCERTAINTY


@inlined
def next_active_set(
    event: ArcEnd, active, held, is_closed, problem, x, series, work, loop: LoopState, recent_step
) -> tuple[bool, np.ndarray, HeldSet, np.ndarray]:
    """Find the active set after an event, or report that it is not certain.

    event: the ArcEnd of the last arc, whose active set and HeldSet are given. is_closed (m,):
    contacts that are active or depend on those. x (n,): put on the new set. series, work: written.
    recent_step: a step of the integrator, the time scale.
    Returns (certain, active, HeldSet, role (m,)), with mu and the series up to the velocity.
    """
    settings, floats, _ = loop
    role = _initial_roles(active, is_closed)
    start = x.copy()
    small = settings.undecided * floats.drift_size[0]
    certain, trial, rising, opening = _first_trial_set(
        event, active, held, role, problem, x, settings, floats, recent_step
    )
    entering = event.entry if event.closing else -1
    entries = all_entries(is_closed.size)
    # Active-set iteration on the velocity problem: drop a negative multiplier, add a closing gap.
    for _ in range(MAX_SET_CHANGES):
        if not certain:
            break
        certain, factored = _solve_velocity(
            trial, start, x, problem, series, work, settings, floats
        )
        if not certain:
            break
        velocity = series.state[1]
        if entering >= 0:
            certain = _is_independent(entering, trial, factored, problem, x, velocity, settings)
            entering = -1
        a = _weakest_member(trial, factored, problem, small, rising)
        if a >= 0 and certain:
            certain, which, _, _ = _find_replacement(
                a, trial, factored, role, problem.contacts, problem.layout, x, settings.dependent
            )
            certain &= not (event.closing and trial[a] == event.entry)
            trial = _remove_member(a, trial, which, role)
            continue
        k, speed = _closing_contact(role, entries, opening, problem, x, velocity, settings, floats)
        if a == -1 and k == -1 and certain:
            return True, trial, factored, role
        certain &= a == -1 and k >= 0
        if certain and speed < -small:
            trial = toggled(trial, k, one())
            role[k] = ACTIVE + NEW
            entering = k
        elif certain:
            certain = _is_dependent(k, trial, factored, problem, x, settings)
            role[k] = DEPENDENT + NEW
    return False, active, held, role
