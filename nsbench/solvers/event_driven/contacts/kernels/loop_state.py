"""Named tuples of the state that the compiled event loop shares with its driver, and loop codes.

Values that do not change during a call are scalars (LoopSettings). Values that the loop writes are
arrays of length 1, so that both sides see them.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from nsbench.dynamics.contacts.kernels.contact_arrays import Contacts, Layout


class LoopCode(IntEnum):
    """Why the loop returned.

    DONE: the end of the run. CHOOSE: the driver must solve the complementarity problem. REBUILD:
    the candidates are no longer certain to be all. FAIL: the run should start again in Python.
    PAUSE: the event log must be read.
    """

    DONE = 0
    CHOOSE = 1
    REBUILD = 2
    FAIL = 3
    PAUSE = 4


# Kinds of events. FIRST is added to the first event of an instant.
CONTACT = 0
RELEASE = 1
PIVOT = 2
FIRST = 4


class AffineDrift(NamedTuple):
    """f(x) = A x + constant: A as CSR (ptr, cols, vals), constant (n,).

    Of a drift that a DriftProgram computes: which x_j each f_i depends on, with zeros as values.
    """

    ptr: np.ndarray
    cols: np.ndarray
    vals: np.ndarray
    constant: np.ndarray


class DriftProgram(NamedTuple):
    """Traced operations of a drift f(t, x) and the work arrays of its series and certificate.

    ops, nums, first (3,): as in Programs of the Filippov loop (event_driven.filippov.kernels
    .loop_state). out (n,): the rows of f; none: the drift is an AffineDrift. table
    (rows, order + 1): Taylor coefficients of all operations on a step. paths (2 n, order + 1):
    polynomials of state and drift on a piece of it. middles, radii (rows, ORDER + 1): its
    enclosure. points (rows, ORDER): values at nodes. width (1,): of a piece for which the
    certificate should hold.
    """

    ops: np.ndarray
    nums: np.ndarray
    first: np.ndarray
    out: np.ndarray
    table: np.ndarray
    paths: np.ndarray
    middles: np.ndarray
    radii: np.ndarray
    points: np.ndarray
    width: np.ndarray


class ContactProblem(NamedTuple):
    """Candidate contacts and the flow between them, constant during a call.

    list_centre (n,): state at which the candidates were listed. norm (m,): lengths of the
    gradients.
    hard (families, 3): first coordinate, particles and dimension of each family of hard particles.
    width: entries of the longest gradient. order: of the Taylor series.
    """

    list_centre: np.ndarray
    contacts: Contacts
    layout: Layout
    norm: np.ndarray
    drift: AffineDrift
    program: DriftProgram
    hard: np.ndarray
    width: int
    order: int


class LoopSettings(NamedTuple):
    """Tolerances and limits, constant during a call.

    end: end of the run. tol: tolerance of the run. step_error: relative error of one step.
    max_step: bound on a step. box: |x_i| up to which the drift is known to be affine; inf for a
    DriftProgram. reach: cutoff of the candidates beyond contact. undecided, strict: sizes relative
    to the drift below which a multiplier or speed is not decided, and above which it is decided
    ahead. dependent: squared sine of dependent gradients. length: characteristic length of the
    case. max_steps: limit of the run.
    """

    end: float
    tol: float
    step_error: float
    max_step: float
    box: float
    reach: float
    undecided: float
    strict: float
    dependent: float
    length: float
    max_steps: int


class LoopFloats(NamedTuple):
    """Float64 arrays of length 1. drift_size: largest |f| so far."""

    time: np.ndarray
    drift_size: np.ndarray
    longest_step: np.ndarray


class LoopCounters(NamedTuple):
    """Int64 arrays of length 1.

    sample: next sample time. steps, arcs: taken. events: in the log. columns: in use, of the
    impulses. closing_entry: contact that just closed, or -1. event_entry: that, or the one whose
    multiplier vanished. touches: dips that count as no event. active_sets: chosen by the loop.
    max_closed: most contacts closed at once. orders: of series computed. recent_steps: arcs entered
    in the ring of their largest steps.
    """

    sample: np.ndarray
    steps: np.ndarray
    arcs: np.ndarray
    events: np.ndarray
    columns: np.ndarray
    closing_entry: np.ndarray
    event_entry: np.ndarray
    touches: np.ndarray
    active_sets: np.ndarray
    max_closed: np.ndarray
    orders: np.ndarray
    recent_steps: np.ndarray


class LoopState(NamedTuple):
    """Settings, floats and counters of a call."""

    settings: LoopSettings
    floats: LoopFloats
    counters: LoopCounters


class Scratch(NamedTuple):
    """Vectors (n,) to work in. zeros: left as zeros."""

    bound: np.ndarray
    vector: np.ndarray
    zeros: np.ndarray


class Series(NamedTuple):
    """Taylor coefficients about the start of a step: state (order + 1, n), drift (order, n)."""

    state: np.ndarray
    drift: np.ndarray


class ArcEnd(NamedTuple):
    """Event that ended an arc: entry of the contact, whether it closed, slope of its multiplier.

    The slope is 0.0 if the contact closed; else its multiplier vanished with that time derivative.
    """

    entry: int
    closing: bool
    slope: float


class SampleRecord(NamedTuple):
    """Sample times; state and reaction (samples, n) and impulse (samples, columns) there."""

    time: np.ndarray
    state: np.ndarray
    reaction: np.ndarray
    impulse: np.ndarray


class Accumulated(NamedTuple):
    """Integrals up to now.

    column (m,): column of each candidate in the impulses, or -1 if it never acted. impulse
    (columns,):
    of the multipliers. reaction (n,): of G^T lam.
    """

    column: np.ndarray
    impulse: np.ndarray
    reaction: np.ndarray


class EventLog(NamedTuple):
    """Events of this call: time, kind and entry of the candidates."""

    time: np.ndarray
    kind: np.ndarray
    entry: np.ndarray
