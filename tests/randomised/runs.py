"""One run of a case by a method, measured: a trajectory, a sentence at the border, or a crash."""

from __future__ import annotations

import linecache
import re
import traceback
import warnings
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

import nsbench
from nsbench import solvers
from nsbench.measure.context import context_of
from nsbench.problem import LCS, Complementarity

EVENTS = 400  # that a run of event_driven may meet: one costs up to 0.1 s


@dataclass(frozen=True)
class Verdict:
    """word: fine, own (by its own residuals alone), told (a status that is not ok, or a sentence at
    the border), refused, slow, open (nothing to judge it by), wrong, crash; status: of the finest
    run."""

    word: str
    status: str = ""
    why: str = ""


@dataclass
class Outcome:
    """A trajectory with what the bench measures of it, or a sentence at the border, or a crash."""

    traj: object = None
    measured: dict = field(default_factory=dict)
    told: str = ""
    crash: str = ""

    @property
    def ok(self) -> bool:
        return self.traj is not None and self.traj.status.ok


def attempt(case, spec: str, value: float) -> Outcome:
    """One run, measured. Budgets of event_driven are of EVENTS too. Circuits have larger ones:
    integrators other than the own one take many steps for each of it."""
    if spec.startswith("event_driven[") and "max_events" not in spec:
        spec = f"{spec[:-1]},max_events={EVENTS}]"
    if isinstance(case.problem, LCS):
        spec = re.sub(r"(max_steps|max_events)=(\d+)", lambda m: f"{m[1]}={20 * int(m[2])}", spec)
    method = solvers.get(spec)
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        try:
            traj = solvers.solve(case, spec, **{method.accuracy: value})
        except Exception as e:
            return (
                Outcome(told=str(e))
                if on_purpose(e)
                else Outcome(crash=f"{type(e).__name__}: {e} at {_place(e)}")
            )
        try:
            return Outcome(traj, nsbench.errors(case, traj))
        except Exception as e:
            return Outcome(traj, crash=f"measuring: {type(e).__name__}: {e} at {_place(e)}")


def on_purpose(e: Exception) -> bool:
    """Whether the package raised it itself, as bad input is told."""
    if not isinstance(e, (ValueError, TypeError, LookupError)):
        return False
    last = traceback.extract_tb(e.__traceback__)[-1]
    return "nsbench" in Path(last.filename).parts and "raise" in linecache.getline(
        last.filename, last.lineno
    )


def _place(e) -> str:
    last = traceback.extract_tb(e.__traceback__)[-1]
    return f"{Path(last.filename).name}:{last.lineno}"


def relative(a, b, one, round_off=0.0) -> float:
    """Largest |a - b|, less what rounding is allowed, over the larger of `one` and how far b moves;
    infinite where something is not finite."""
    d = np.maximum(np.abs(a - b) - round_off, 0.0) / max(
        one, float(np.abs(b - b[0]).max(initial=0.0))
    )
    return float(np.max(np.where(np.isfinite(d), d, np.inf), initial=0.0))


def kept_feasible(case) -> bool:
    """Whether a start that is kept is feasible: then it is the same as one that is projected, and
    can be followed."""
    p = case.problem
    if case.start != "keep" or not (isinstance(p, Complementarity) and p.constraints):
        return False
    with np.errstate(all="ignore"):
        return context_of(case).scene.max_violation(float(case.t[0]), case.x0) <= 0.0
