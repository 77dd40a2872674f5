"""The event-driven method on Complementarity systems as machine code, where drift and constraints
allow it.

kernels.walk follows arcs and takes the choices that are beyond doubt; the others are taken here, by
_selection. Whatever does not end well is told by the loop in Python (see _constrained), which
starts again from the beginning.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.case import Case
from nsbench.problem import Smooth
from nsbench.solvers.event_driven.contacts import active_set
from nsbench.solvers.event_driven.contacts.affine_drift import affine_drift
from nsbench.solvers.event_driven.contacts.compiled_choice import choose, parts
from nsbench.solvers.event_driven.contacts.gram_matrix import LONG, compile_sparse
from nsbench.solvers.event_driven.contacts.kernels import loop_state
from nsbench.solvers.event_driven.smooth.arc import SHARE
from nsbench.trajectory import Event

ROOM = 10.0  # times the size of the start: the box on which the drift is known to be affine
SPARE = 0.01  # of the share of an arc's step: series cost little more to be this much better
FLOOR = 1e-16  # below the spacing of numbers nothing is gained
ORDERS = (8, 24)  # of the series: as few terms as an event is found with, as many as ever pay
KINDS = ("contact", "release", "pivot")
LOG = 1024  # events between two looks at whether they accumulate


@dataclass(frozen=True, eq=False)
class CompiledSetup:
    """What a run needs that does not change: the drift as CSR and constant, the part it gives each
    coordinate to (see _contact_choice), the box, hard particles, order and eps."""

    drift: tuple
    label: np.ndarray
    box: float
    hard: np.ndarray
    order: int
    eps: float


def plan(case: Case, field, x, options, tol: float) -> CompiledSetup | None:
    """None where the loop in Python is meant: other integrators, moving or smooth constraints,
    drifts that bend."""
    scene = field.scene
    if (
        options.method != "dop853"
        or scene.moving
        or any(isinstance(c, Smooth) for c in scene.families)
    ):
        return None
    box = ROOM * (1.0 + float(np.abs(x).max()))
    drift = affine_drift(case, box)
    if drift is None:
        return None
    hard = np.array([(c.start, m, c.dim) for _, c, m in scene.hard], np.int64).reshape(-1, 3)
    eps = max(SPARE * SHARE * tol, FLOOR)
    order = int(
        np.clip(np.ceil(1.0 - 0.5 * np.log(eps)), ORDERS[0] + 2, ORDERS[1])
    )  # Jorba & Zou 2005, eq. 10
    return CompiledSetup(drift, parts(drift), box, hard, order, eps * field.unit)


def load(walk, p: CompiledSetup):
    """Load or compile the kernels: a run of no length."""
    walk.T = walk.t
    run(walk, p)
    if walk.field.certified or len(walk.all) > LONG:
        compile_sparse()


def run(walk, p: CompiledSetup) -> bool:
    """Carry `walk` (see _constrained) to its end; False where it should start again in Python."""
    from nsbench.solvers.event_driven.contacts.kernels.loop import integrate_contacts as kernel

    with np.errstate(all="ignore"):
        walk._record(walk.x[None], np.zeros((1, 0)), np.zeros((1, walk.case.n)))
        if not walk._start().ok:
            return False
        return KernelDriver(walk, p, kernel).run()


class KernelDriver:
    """Moves data between `walk` and the kernel."""

    def __init__(self, walk, p, kernel):
        self.walk = walk
        self.plan = p
        self.kernel = kernel
        self.num = np.zeros(loop_state.FLOATS)
        self.cnt = np.zeros(loop_state.INTS, np.int64)
        self.num[[loop_state.END, loop_state.TOL, loop_state.EPS]] = walk.T, walk.tol, p.eps
        self.num[loop_state.UNIT] = walk.field.unit
        self.num[[loop_state.MAX_STEP, loop_state.BOX, loop_state.REACH]] = (
            walk.options.max_step,
            p.box,
            walk.field.reach,
        )
        self.num[[loop_state.DOUBT, loop_state.STRICT, loop_state.DEPENDENT]] = (
            active_set.UNDECIDED,
            active_set.STRICT,
            active_set.DEPENDENT,
        )
        self.cnt[loop_state.MAX_STEPS] = walk.options.max_steps
        self.paces = np.zeros(10)
        self.paces[0] = walk.paces[0]
        self.cnt[loop_state.PACES] = 1
        self.paths = np.full((2, len(walk.case.t), walk.case.n), np.nan)
        self.paths[0, 0] = walk.X[0]
        self.paths[1, 0] = 0.0
        self.cnt[loop_state.SAMPLE] = 1
        self.impulse = np.zeros((len(walk.case.t), 0))
        self.total = np.zeros(0)
        self.listed = None
        self.column = np.empty(0, np.int64)
        self.known = np.empty(0, np.int64)
        self.log = (np.empty(LOG), np.empty(LOG, np.int64), np.empty(LOG, np.int64))

    def run(self) -> bool:
        walk = self.walk
        while True:
            code = self._go()
            if code == loop_state.DONE:
                return self._finish()
            if code == loop_state.FAIL:
                return False
            if code == loop_state.RELIST:
                self.cnt[loop_state.ARCS] += 1  # as in Python, an arc ends here
                walk._relist()
                continue
            if code == loop_state.CHOOSE:
                walk.meetings.append(walk.t)
            if walk._budget() is not None:
                return False
            if code == loop_state.CHOOSE:
                walk.paces = self.paces.tolist()
                walk.selector.size = float(self.num[loop_state.SIZE])
                if not choose(
                    walk,
                    self.plan.label,
                    int(self.cnt[loop_state.FIRED]),
                    int(self.cnt[loop_state.ENTRY]),
                ):
                    return False

    def _go(self):
        """One stay in the kernel."""
        walk = self.walk
        near = self.walk.all.near
        scene = walk.field.scene
        m = len(near)
        column = self._columns()
        spare = len(walk.column) + m - len(self.total)
        if spare > 0:
            self.total = np.append(self.total, np.zeros(spare + m))
            self.impulse = np.hstack((self.impulse, np.zeros((len(self.impulse), spare + m))))
        listed = (near.kind, near.p, near.q, near.d, near.sign, near.dim)
        places = (walk.field._anchors0, scene.ptr, scene.cols, scene.vals, walk.field._b0)
        basis = np.zeros(m, bool)
        basis[walk.basis] = True
        x = np.array(walk.x)
        self.num[loop_state.T], self.num[loop_state.SIZE] = walk.t, walk.selector.size
        self.cnt[loop_state.EVENTS], self.cnt[loop_state.COLUMNS], self.cnt[loop_state.PEAK] = (
            0,
            len(walk.column),
            walk.peak,
        )
        code = self.kernel(
            listed,
            places,
            walk.all.norm,
            self.plan.drift,
            self.plan.hard,
            walk.all.width,
            self.plan.order,
            x,
            walk.anchor,
            basis,
            walk.kept,
            walk.case.t,
            (self.paths[0], self.paths[1], self.impulse),
            (column, self.total, walk.reaction),
            self.paces,
            self.log,
            self.num,
            self.cnt,
        )
        walk.t = float(self.num[loop_state.T])
        walk.x = x
        walk.basis = np.flatnonzero(basis)
        walk.peak = int(self.cnt[loop_state.PEAK])
        walk.selector.size = float(self.num[loop_state.SIZE])
        self._names(near, column)
        return code

    def _columns(self):
        """(m,) column of each entry of the list in the impulses, or -1: kept while the list is the
        same."""
        walk = self.walk
        if self.listed is not walk.all:
            key = walk.all.near.key
            self.listed = walk.all
            self.column = np.full(len(key), -1, np.int64)
            if len(self.known):
                order = np.argsort(self.known)
                at = order[
                    np.minimum(np.searchsorted(self.known, key, sorter=order), len(order) - 1)
                ]
                self.column[self.known[at] == key] = at[self.known[at] == key]
        return self.column

    def _names(self, near, column):
        """Contacts that acted for the first time, and events, by their ids."""
        walk = self.walk
        new = np.flatnonzero(column >= len(walk.column))
        new = new[np.argsort(column[new])]
        self.known = np.append(self.known, near.take(new).key)
        for e, c in zip(new, near.take(new).ids, strict=True):
            walk.column[c] = int(column[e])
        count = int(self.cnt[loop_state.EVENTS])
        if count:
            times, kinds, entries = (a[:count] for a in self.log)
            for t, kind, c in zip(
                times.tolist(), kinds.tolist(), near.take(entries).ids, strict=True
            ):
                walk.events.append(Event(t, KINDS[kind % loop_state.FIRST], c))
                if kind >= loop_state.FIRST:
                    walk.meetings.append(t)

    def _finish(self) -> bool:
        walk = self.walk
        c = len(walk.column)
        walk.X = self.paths[0]
        walk.R = self.paths[1]
        walk.done = int(self.cnt[loop_state.SAMPLE])
        walk.impulses = list(self.impulse[:, :c])
        walk.steps = int(self.cnt[loop_state.STEPS])
        walk.arcs = int(self.cnt[loop_state.ARCS]) + 1
        walk.h = float(self.num[loop_state.H])
        walk.proof["touches"] = int(self.cnt[loop_state.TOUCHES])
        walk.field.calls += int(self.cnt[loop_state.ORDERS])
        walk.selector.solved += int(self.cnt[loop_state.SOLVED])
        walk.loop = "compiled"
        return True
