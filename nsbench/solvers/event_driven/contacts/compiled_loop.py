"""Drive the compiled event loop on Complementarity systems whose drift and constraints allow it.

kernels.loop follows arcs and takes the choices of the active set that are certain; the others are
taken here, by active_set. A run that does not end well is not described here: it starts again in
Python (see host_loop).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from nsbench.case import Case
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.problem import Smooth
from nsbench.solvers.event_driven.contacts import active_set
from nsbench.solvers.event_driven.contacts.affine_drift import affine_drift
from nsbench.solvers.event_driven.contacts.drift_program import (
    NO_PROGRAM,
    dependences,
    drift_program,
)
from nsbench.solvers.event_driven.contacts.evaluation import ContactField
from nsbench.solvers.event_driven.contacts.gram_matrix import MAX_DENSE_ROWS, compile_sparse
from nsbench.solvers.event_driven.contacts.kernels import loop_state
from nsbench.solvers.event_driven.contacts.kernels.loop_state import LoopCode
from nsbench.solvers.event_driven.smooth.arc import STEP_SHARE
from nsbench.trajectory import Event

if TYPE_CHECKING:
    from nsbench.solvers.event_driven.contacts.host_loop import ContactIntegrator
    from nsbench.solvers.event_driven.filippov.program import TracedPrograms

BOX_FACTOR = 10.0  # times 1 + the largest |x_i| of the start: box on which the drift must be affine
SERIES_SHARE = 0.01  # of the error of a step: a series that much better costs little more
MIN_STEP_ERROR = 1e-16  # relative: below the spacing of numbers nothing is gained
ORDERS = (8, 24)  # of the series, less two: what locating an event takes, and the most that pays
EVENT_KINDS = ("contact", "release", "pivot")  # by the kinds of loop_state
LOG_LENGTH = 1024  # events between two checks of whether they accumulate
RECENT_ARCS = 10  # arcs whose largest step is the time scale of the look-ahead


@dataclass(frozen=True, eq=False)
class CompiledSetup:
    """Constants of a compiled run.

    drift, program: see loop_state. labels (n,): part of each coordinate that the drift couples (see
    active_set). box: |x_i| up to which the drift is affine. hard (families, 3): first coordinate,
    particles and dimension of hard particles. order: of the series. step_error: of one step,
    relative.
    """

    drift: loop_state.AffineDrift
    program: loop_state.DriftProgram
    labels: np.ndarray
    box: float
    hard: np.ndarray
    order: int
    step_error: float


@dataclass(frozen=True, eq=False)
class CompiledRun:
    """Results of a finished compiled run."""

    samples: loop_state.SampleRecord
    counters: loop_state.LoopCounters
    longest_step: float


def why_in_python(options, constraints: ConstraintSet) -> str:
    """Say why a case with these constraints has no compiled loop, whatever its drift; else ""."""
    if options.method != "dop853":
        return f"method={options.method} is set, and the compiled loop has its own integrator"
    if not options.compiled:
        return "compiled=false is set"
    if any(isinstance(c, Smooth) for c in constraints.families):
        return "a Smooth constraint is no Affine or Distance"
    if constraints.moving:
        return "constraints move"
    return ""


def plan_affine_run(
    case: Case, field: ContactField, x: np.ndarray, tol: float
) -> CompiledSetup | None:
    """Set up a compiled run from the start x (n,); None if the drift is not proven to be affine."""
    box = BOX_FACTOR * (1.0 + float(np.abs(x).max()))
    drift = affine_drift(case, box)
    if drift is None:
        return None
    order, step_error = _order_and_step_error(tol)
    return _set_up(field, drift, NO_PROGRAM, box, order, step_error)


def plan_traced_run(traced: TracedPrograms, field: ContactField, tol: float) -> CompiledSetup:
    """Set up a compiled run whose drift is a traced program without kinks."""
    order, step_error = _order_and_step_error(tol)
    program = drift_program(traced, order)
    return _set_up(field, dependences(traced), program, np.inf, order, step_error)


def _order_and_step_error(tol):
    """Return the order of the series and the relative error of a step (Jorba & Zou 2005, eq.
    10)."""
    step_error = max(SERIES_SHARE * STEP_SHARE * tol, MIN_STEP_ERROR)
    order = int(np.clip(np.ceil(1.0 - 0.5 * np.log(step_error)), ORDERS[0] + 2, ORDERS[1]))
    return order, step_error


def _set_up(field, drift, program, box, order, step_error) -> CompiledSetup:
    hard = [(c.start, m, c.dim) for _, c, m in field.constraints.hard]
    return CompiledSetup(
        drift,
        program,
        active_set.label_parts(drift),
        box,
        np.array(hard, np.int64).reshape(-1, 3),
        order,
        step_error * field.length,
    )


def load(integrator: ContactIntegrator, setup: CompiledSetup) -> None:
    """Load or compile the kernels by a run of no length."""
    integrator.end = integrator.t
    run(integrator, setup)
    if integrator.field.certified or len(integrator.candidates) > MAX_DENSE_ROWS:
        compile_sparse()


def run(integrator: ContactIntegrator, setup: CompiledSetup) -> bool:
    """Integrate to the end; False if the run should start again in Python."""
    with np.errstate(all="ignore"):
        if not integrator.start().ok:
            return False
        return KernelDriver(integrator, setup).run()


class KernelDriver:
    """Move data between a ContactIntegrator and the kernel, and act on the code it returns.

    Of the integrator it uses the attributes and methods that its docstring names.
    """

    def __init__(self, integrator: ContactIntegrator, setup: CompiledSetup):
        case = integrator.case
        self.integrator = integrator
        self.setup = setup
        setup.program.width[:] = np.inf  # nothing is handed on from run to run
        self.loop = _loop_state(integrator, setup)
        self.recent_steps = np.zeros(RECENT_ARCS)
        self.recent_steps[0] = integrator.recent_steps[0]
        self.loop.counters.recent_steps[0] = 1
        self.samples = loop_state.SampleRecord(
            case.t,
            np.full((len(case.t), case.n), np.nan),
            np.full((len(case.t), case.n), np.nan),
            np.zeros((len(case.t), 0)),
        )
        self.samples.state[0] = integrator.x
        self.samples.reaction[0] = 0.0
        self.loop.counters.sample[0] = 1
        self.accumulated = loop_state.Accumulated(
            np.empty(0, np.int64), np.zeros(0), np.zeros(case.n)
        )
        self.log = loop_state.EventLog(
            np.empty(LOG_LENGTH), np.empty(LOG_LENGTH, np.int64), np.empty(LOG_LENGTH, np.int64)
        )
        self.listed = None  # the candidates that `accumulated.column` belongs to
        self.column_keys = np.empty(0, np.int64)  # key of the contact of each column

    def run(self) -> bool:
        """Run the kernel until the end; False if the run should start again in Python."""
        integrator = self.integrator
        counters = self.loop.counters
        while True:
            code = self._call_kernel()
            if len(integrator.event_times) > integrator.options.max_events:
                return False
            if code == LoopCode.DONE:
                integrator.adopt_compiled_run(
                    CompiledRun(self.samples, counters, float(self.loop.floats.longest_step[0]))
                )
                return True
            if code == LoopCode.FAIL:
                return False
            if code == LoopCode.REBUILD:
                counters.arcs[0] += 1  # as in Python, an arc ends here
                integrator.rebuild_candidates()
                continue
            if code == LoopCode.CHOOSE:
                integrator.event_times.append(integrator.t)
            if integrator.check_event_limits() is not None:
                return False
            if code == LoopCode.CHOOSE and not self._choose_active_set():
                return False

    def _choose_active_set(self) -> bool:
        """Let the integrator choose the active set; False if there is none."""
        integrator = self.integrator
        counters = self.loop.counters
        integrator.recent_steps = self.recent_steps.tolist()
        return integrator.choose_active_set(
            int(counters.closing_entry[0]), int(counters.event_entry[0]), self.setup.labels
        ).ok

    def _call_kernel(self) -> LoopCode:
        """Run the kernel once from the state of the integrator, and write its results back."""
        from nsbench.solvers.event_driven.contacts.kernels.loop import integrate_contacts

        integrator = self.integrator
        floats = self.loop.floats
        counters = self.loop.counters
        rows = integrator.candidates
        self._provide_columns()
        is_active = active_set.mask_of(len(rows), integrator.active)
        x = np.array(integrator.x)
        floats.time[0] = integrator.t
        floats.drift_size[0] = integrator.selector.drift_size
        counters.events[0] = 0
        counters.columns[0] = len(integrator.columns)
        counters.max_closed[0] = integrator.max_closed
        problem = loop_state.ContactProblem(
            integrator.list_centre,
            rows.listed.contacts,
            integrator.field.initial_layout,
            rows.norm,
            self.setup.drift,
            self.setup.program,
            self.setup.hard,
            rows.width,
            self.setup.order,
        )
        code = integrate_contacts(
            problem,
            x,
            is_active,
            integrator.closed,
            self.samples,
            self.accumulated,
            self.recent_steps,
            self.log,
            self.loop,
        )
        integrator.t = float(floats.time[0])
        integrator.x = x
        integrator.active = np.flatnonzero(is_active)
        integrator.max_closed = int(counters.max_closed[0])
        integrator.selector.drift_size = float(floats.drift_size[0])
        self._read_columns()
        self._read_log()
        return code

    def _provide_columns(self):
        """Find the column of each candidate in the impulses, and make room for all to act."""
        integrator = self.integrator
        total = self.accumulated.impulse
        m = len(integrator.candidates)
        if self.listed is not integrator.candidates:
            self.listed = integrator.candidates
            column = _find_keys(self.listed.listed.key, self.column_keys)
            self.accumulated = self.accumulated._replace(column=column)
        missing = len(integrator.columns) + m - len(total)
        if missing > 0:
            more = missing + m
            self.accumulated = self.accumulated._replace(impulse=np.append(total, np.zeros(more)))
            impulse = self.samples.impulse
            self.samples = self.samples._replace(
                impulse=np.hstack((impulse, np.zeros((len(impulse), more))))
            )

    def _read_columns(self):
        """Name the columns of contacts that acted for the first time."""
        columns = self.integrator.columns
        column = self.accumulated.column
        new = np.flatnonzero(column >= len(columns))
        new = new[np.argsort(column[new])]
        contacts = self.listed.listed.take(new)
        self.column_keys = np.append(self.column_keys, contacts.key)
        for entry, contact in zip(new, contacts.ids, strict=True):
            columns[contact] = int(column[entry])

    def _read_log(self):
        """Append the logged events; the first of each instant counts as a time of events."""
        count = int(self.loop.counters.events[0])
        if not count:
            return
        ids = self.listed.listed.take(self.log.entry[:count]).ids
        times = self.log.time[:count].tolist()
        kinds = self.log.kind[:count].tolist()
        for t, kind, contact in zip(times, kinds, ids, strict=True):
            event = Event(t, EVENT_KINDS[kind % loop_state.FIRST], contact)
            self.integrator.events.append(event)
            if kind >= loop_state.FIRST:
                self.integrator.event_times.append(t)


def _loop_state(integrator, setup) -> loop_state.LoopState:
    """Return settings from options and setup, with floats and counters at zero."""
    settings = loop_state.LoopSettings(
        end=integrator.end,
        tol=integrator.tol,
        step_error=setup.step_error,
        max_step=float(integrator.options.max_step),
        box=setup.box,
        reach=float(integrator.field.reach),
        undecided=active_set.UNDECIDED,
        strict=active_set.STRICT,
        dependent=active_set.DEPENDENT,
        length=float(integrator.field.length),
        max_steps=integrator.options.max_steps,
    )
    floats = loop_state.LoopFloats(*(np.zeros(1) for _ in loop_state.LoopFloats._fields))
    counters = loop_state.LoopCounters(
        *(np.zeros(1, np.int64) for _ in loop_state.LoopCounters._fields)
    )
    return loop_state.LoopState(settings, floats, counters)


def _find_keys(keys: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Return the position of each of `keys` among the known ones, or -1; (m,)."""
    position = np.full(len(keys), -1, np.int64)
    if len(known):
        order = np.argsort(known)
        at = order[np.minimum(np.searchsorted(known, keys, sorter=order), len(order) - 1)]
        position[known[at] == keys] = at[known[at] == keys]
    return position
