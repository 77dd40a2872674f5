"""Trajectory, Status and Event: what a run returns."""

from __future__ import annotations

import errno
import os
from dataclasses import dataclass, field

import numpy as np

STATUSES = (
    "ok",
    "unverified",
    "below_reference",
    "refused",
    "diverged",
    "nan",
    "infeasible",
    "degenerate",
    "chatter",
    "maxiter",
    "timeout",
    "oom",
    "crashed",
    "error",
)
LAM_TIMES = ("start", "midpoint", "end", "mean")
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
    """A located event: its time, kind (contact, release, enter, exit, cross, pivot) and the
    contact's id."""

    t: float
    kind: str
    contact: tuple


@dataclass(frozen=True)
class Trajectory:
    """Samples of one run.

    t (k,), x (k, n); contacts: ids of the m contacts that ever acted, (family, i) or (family, i,
    j);
    impulse (k, m): cumulative integral of lambda dt (Filippov: of the weight theta of the positive
    side, contact (0, i) for surface i); reaction (k, n): cumulative integral of sum lambda_k grad
    g_k dt, unique even where lambda is not (Filippov: empty, (k, 0)). After a failure the remaining
    samples are NaN.
    lam_time: where in its step the method's multiplier belongs: "end", "start", "midpoint" or
    "mean".
    lam (k, m), lam_h (k,): multiplier and length of the last step before each sample, of fixed-step
    methods, in cases whose multiplier is known at any time; NaN where it is not known (the first
    sample has no step). See measure.labels.
    between: times (j,), states (j, n) and impulses (j, m) after some steps between samples, of
    Filippov systems and as far as a method keeps them: what a run may have gone through unseen.
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


def machine_fault(e: BaseException) -> str:
    """Return the end of a sentence if files, disk or threads of the machine caused the exception,
    however a library reports it; "" if not.
    """
    words = [*map(os.strerror, SHORT), "can't start new thread"]
    told = set()
    below = e
    while below is not None and id(below) not in told:
        if isinstance(below, OSError) or any(w in str(below) for w in words):
            return (
                f" ({MACHINE})" if below is e else f" ({MACHINE}: {type(below).__name__}: {below})"
            )
        told.add(id(below))
        below = below.__cause__ or below.__context__
    return ""
