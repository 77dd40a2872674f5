"""Trajectory, Status and Event: what a run returns."""

from __future__ import annotations

import errno
import os
import traceback
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import numpy as np

from nsbench.html_summary import summary_table

STATUS_MEANINGS = {
    "ok": "the run reached its end time, and no check found a reason to doubt it",
    "unverified": "the run reached its end time, but the error that its method claims is not "
    "certain",
    "below_reference": "the error is below ten times the bound of the reference: too small to be "
    "measured",
    "refused": "the method does not take the case; nothing ran",
    "diverged": "the state grew beyond all bounds, or passed a pole that no solution passes",
    "nan": "a function of the case, or the state, is not a number",
    "infeasible": "no state satisfies the constraints, or the run does not",
    "degenerate": "the solution is not unique, or a contact has no normal",
    "chatter": "events accumulate at one time",
    "maxiter": "a limit of steps, events or iterations was reached",
    "timeout": "the time limit of a run was reached",
    "oom": "the memory of a run was not sufficient",
    "crashed": "the process of the run ended",
    "error": "the method, the case or the machine raised an error",
}
STATUSES = tuple(STATUS_MEANINGS)  # a closed list
# of runs that have reached their end time, or were not to run; all others are failures
NO_FAILURE = ("ok", "unverified", "below_reference", "refused")
LAM_TIMES = ("start", "midpoint", "end", "mean")
RULES = ("", "explicit", "implicit")
# parts of a run with switches after each of which a method stores a state in `between`
STATES_BETWEEN = 100
# in the sentence of an "error" that may be gone when the run is made again
MACHINE = "a fault of the machine"
SHORT = (
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EIO,
    errno.EMFILE,
    errno.ENFILE,
    errno.ENOMEM,
    errno.EAGAIN,
)


# functions that read or write code which is stored on the disk, by module: what goes wrong in them
# is a damaged file, whatever exception it ends in
STORED_CODE = {
    "numba.core.caching": ("_load_index", "_load_data", "_save_index", "_save_data", "rebuild"),
    "importlib._bootstrap_external": ("_compile_bytecode",),
    "_frozen_importlib_external": ("_compile_bytecode",),
}


def utf8_safe(text: str) -> str:
    """Return the text as UTF-8 can encode it: surrogates, as file names may hold them, are written
    as numbers.
    """
    return text.encode("utf-8", "backslashreplace").decode()


@dataclass(frozen=True)
class Status:
    """One word of a closed list and, unless ok, a sentence a person can act on."""

    code: str = "ok"
    why: str = ""
    check: str = ""  # name of the check of nsbench.diagnostics that gave this status

    def __post_init__(self):
        if self.code not in STATUSES:
            raise ValueError(f"status {self.code!r} is not one of {STATUSES}")

    @property
    def ok(self) -> bool:
        return self.code == "ok"

    def __str__(self) -> str:
        return self.why or (
            "The run reached its end time." if self.ok else f"The run ended: {self.code}."
        )


@dataclass(frozen=True)
class Event:
    """A located event: its time, kind (contact, release, enter, exit, cross, pivot, transition) and
    the id of the contact, surface or transition."""

    t: float
    kind: str
    contact: tuple


@dataclass(frozen=True)
class Resolution:
    """What a method resolves: lengths and tolerances that the checks of a finished run need.

    step: length of its fixed steps, 0.0 where it has none.
    layer: half-width of the layer |c| < layer in which a switch c is regularised, 0.0 where the
    sign is sharp. stiffness: k of the springs that hold the constraints, 0.0 where none do.
    rule: "explicit" or "implicit" for fixed steps that take the field at their start or their end,
    "" for all other methods.
    tolerance: relative tolerance of the step control of an integrator, 0.0 where none is to be
    checked. claimed_error: the error that the method claims, and max_tolerance: the largest
    tolerance, relative to the motion, that does not hide an error of this size.
    """

    step: float = 0.0
    layer: float = 0.0
    rule: str = ""
    tolerance: float = 0.0
    claimed_error: float = 0.0
    max_tolerance: float = np.inf
    stiffness: float = 0.0

    def __post_init__(self):
        if self.rule not in RULES:
            raise ValueError(f"rule is {self.rule!r}; one of {RULES}")


@dataclass(frozen=True, repr=False)
class Trajectory:
    """Samples of one run.

    t (k,), x (k, n); contacts: ids of the m contacts that ever acted, (family, i) or (family, i,
    j);
    impulse (k, m): cumulative integral of lambda dt (Filippov: of the weight theta of the positive
    side, contact (0, i) for surface i; hybrid: time spent in mode i); reaction (k, n): cumulative
    integral of sum lambda_k grad g_k dt, unique even where lambda is not (Filippov, hybrid: empty,
    (k, 0)). After a failure the remaining samples are NaN.
    lam_time: where in its step the method's multiplier belongs: "end", "start", "midpoint" or
    "mean".
    lam (k, m), lam_h (k,): multiplier and length of the last step before each sample, of fixed-step
    methods, in cases whose multiplier is known at any time; NaN where it is not known (the first
    sample has no step). See measure.labels.
    between: times (j,), states (j, n) and impulses (j, m) after some steps between samples, as far
    as a method stores them: what a run may have passed between samples, and what its error bars
    are made from.
    resolution: steps, layer and tolerance of the method; None: unknown, inferred from stats["h"]
    and lam_time by the checks.
    bound: the error bars of the run at its samples (nsbench.error_bars.ErrorBars), computed when
    they are first looked at; None: the method is not one that has any.
    """

    t: np.ndarray
    x: np.ndarray
    contacts: tuple
    impulse: np.ndarray
    reaction: np.ndarray
    status: Status = Status()
    events: tuple[Event, ...] = ()
    stats: dict = field(default_factory=dict)
    lam_time: str = "mean"
    lam: np.ndarray | None = None
    lam_h: np.ndarray | None = None
    between: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
    resolution: Resolution | None = None
    bound: Any = field(default=None, repr=False, compare=False)

    def __repr__(self) -> str:
        """Return what the run is in a line; the arrays are attributes."""
        if not len(self.t):
            return f"Trajectory({self.status.code}, no samples: {self.status})"
        span = f"t = {self.t[0]:g} .. {self.t[-1]:g}"
        return (
            f"Trajectory({self.status.code}, {span}, x {self.x.shape}, "
            f"{len(self.contacts)} contacts, {len(self.events)} events)"
        )

    def _repr_html_(self) -> str:
        """Return status, span, sizes and work as a table, for notebooks."""
        span = f"{self.t[0]:g} to {self.t[-1]:g}, {len(self.t)} samples" if len(self.t) else "none"
        lines = [
            ("status", f"{self.status.code}: {self.status}"),
            ("time", span),
            ("coordinates", self.x.shape[-1]),
            ("contacts", len(self.contacts)),
            ("events", len(self.events)),
            *self.stats.items(),
        ]
        return summary_table("Trajectory", lines)

    def multiplier(self, contact: tuple) -> np.ndarray:
        """Return (k - 1,) the mean multiplier of one contact over each interval between samples.

        contact: an id of `contacts`, or that of one that never acted, which gives zeros; the two
        ends of a pair in any order. Filippov: the mean weight of the positive side of surface i,
        contact (0, i).
        """
        family, *ends = contact
        contact = (family, *sorted(ends))
        means = np.zeros(max(len(self.t) - 1, 0))
        if contact in self.contacts:
            means = np.diff(self.impulse[:, self.contacts.index(contact)]) / np.diff(self.t)
        return means

    def plot(self, what: str = "state") -> Any:
        """Draw the run over time as a chart (nsbench.plots.Chart).

        what: "state" or "impulse". Raises ValueError for another word, and
        for a run without samples.
        """
        # by name: pictures lie above what they show, and are imported when one is asked for
        return import_module("nsbench.plots").plot_trajectory(self, what)


def machine_fault(e: BaseException) -> str:
    """Return the end of a sentence if files, disk, threads or stored code of the machine caused the
    exception, however a library reports it; "" if not.
    """
    words = [*map(os.strerror, SHORT), "can't start new thread"]
    visited = set()
    below: BaseException | None = e
    while below is not None and id(below) not in visited:
        if (
            isinstance(below, OSError)
            or any(w in str(below) for w in words)
            or _reads_stored_code(below)
        ):
            return (
                f" ({MACHINE})" if below is e else f" ({MACHINE}: {type(below).__name__}: {below})"
            )
        visited.add(id(below))
        below = below.__cause__ or below.__context__
    return ""


def _reads_stored_code(e: BaseException) -> bool:
    """Was the exception raised while code that is stored on the disk was read or written?"""
    return any(
        frame.f_code.co_name in STORED_CODE.get(frame.f_globals.get("__name__", ""), ())
        for frame, _ in traceback.walk_tb(e.__traceback__)
    )
