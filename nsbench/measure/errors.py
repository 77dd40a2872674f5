"""Errors of a run against the reference of its case, with the residuals beside them."""

from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.measure.context import MeasureContext, context_of
from nsbench.measure.event_times import event_errors
from nsbench.measure.multiplier_sets import selection
from nsbench.measure.multiplier_times import NAMES as LABELS
from nsbench.measure.multiplier_times import errors_at_times
from nsbench.measure.residuals import NAMES as RESIDUALS
from nsbench.measure.residuals import residuals
from nsbench.problem import Complementarity
from nsbench.reference import columns_of, spread
from nsbench.trajectory import Trajectory

NAMES = (
    "state_sup",
    "state_T",
    "set_distance",
    "impulse",
    "reaction",
    "l1",
    "settled",
    "sup",
    "event_time",
    "events_missed",
    "events_extra",
    *LABELS,
    "lam_floor",
    "selection",
    "polyhedron",
    "state_floor",
    "impulse_floor",
    "reaction_floor",
    "event_floor",
    "state_scale",
    "impulse_scale",
)
MEASURED = ("ok", "unverified", "degenerate", "below_reference")  # statuses of runs that reached T


def errors(case: Case, traj: Trajectory) -> dict:
    """Errors and residuals of one run, NaN where one has no meaning.

    state_sup, state_T: max norm, over all samples and at the last; impulse, reaction: largest
    difference of the cumulative impulse of any contact, of the cumulative reaction in any
    coordinate, at any sample (contacts are matched by id, one that is absent has none); l1: sum
    over sample intervals and contacts of |difference of the impulse in the interval|, which is the
    L1 distance of interval means; settled: largest difference of interval means of a multiplier
    outside windows of 2 sample spacings around the reference's events; sup: the same everywhere, a
    diagnostic (no order at jumps); event_time, events_missed, events_extra: see `event_errors`.

    lam_own, lam_at_start, lam_at_mid, lam_at_end, lam_mean, lam_floor: the multiplier of single
    steps against the exact one at the method's own time label and at the others, see
    `measure.labels`.
    set_distance: of the samples from the set of all solutions, in the place of state_sup where
    there are many (the case's `distance`, see Case).

    multipliers_unique: rank of the active gradients along the reference (None without one). Where
    False, impulse, l1, settled and sup are NaN: the reaction's error stands in their place,
    polyhedron is the distance of the multipliers to the set of all, selection the one to its
    smallest element, no error.
    state_floor, impulse_floor, reaction_floor, event_floor: ten times the reference's own error;
    errors below say nothing, and `below` names those that are (see `below_reference`); whoever
    prints one prints the floor. state_scale, impulse_scale: at least 1, and the largest value of
    the reference, which rounding is relative to.
    reference: "closed form", "stored" or "none". feasibility, sign, complementarity, residual: see
    `residuals`.
    A run that did not reach T has residuals only. BadReference (a ValueError) if the stored
    reference is unusable.
    """
    made = context_of(case)
    ref = made.ref
    out = {k: float("nan") for k in NAMES}
    out |= {
        "reference": "none" if ref is None else ref.kind,
        "multipliers_unique": made.unique,
        "below": "",
    }
    if not len(traj.t):
        return out | dict.fromkeys(RESIDUALS, float("nan"))
    if not np.array_equal(traj.t, case.t):
        raise ValueError(
            f"the run has {len(traj.t)} samples at times of its own; {case.key} has {len(case.t)}"
        )
    out |= residuals(made, traj)
    if ref is None:
        if case.distance is not None and _finished(traj):
            out["set_distance"] = float(case.distance(traj.t, traj.x))
        return out
    bound = ref.impulse_error if made.unique else ref.reaction_error
    out |= {
        "state_floor": 10.0 * ref.state_error,
        "impulse_floor": 10.0 * bound,
        "reaction_floor": 10.0 * ref.reaction_error,
        "event_floor": 10.0 * ref.event_error,
        "state_scale": _size(ref.x),
        "impulse_scale": max(_size(ref.impulse), _size(ref.reaction)),
    }
    if _finished(traj):
        out |= _against(made, traj)
        out["below"] = " ".join(below_reference(out, case.t))
    return out


def below_reference(row: dict, t: np.ndarray) -> list[str]:
    """Names of the errors in `row` that lie below ten times what the reference's own error can make
    of them."""
    k = len(t) - 1
    gap = float(np.diff(t).min())
    floors = {
        "state_sup": row["state_floor"],
        "state_T": row["state_floor"],
        "impulse": row["impulse_floor"],
        "reaction": row["reaction_floor"],
        "event_time": row["event_floor"],
        # differences of two cumulative impulses: summed over the intervals, or over the shortest of
        # them
        "l1": 2 * k * row["impulse_floor"],
        "settled": 2 * row["impulse_floor"] / gap,
        "sup": 2 * row["impulse_floor"] / gap,
    }
    return [name for name, floor in floors.items() if row[name] < floor]


def _finished(traj: Trajectory) -> bool:
    return traj.status.code in MEASURED and bool(
        np.all(np.isfinite(traj.x)) and np.all(np.isfinite(traj.impulse))
    )


def _size(values) -> float:
    return 1.0 if values is None else max(1.0, float(np.abs(values).max(initial=0.0)))


def _against(made: MeasureContext, traj: Trajectory) -> dict:
    ref = made.ref
    off = np.abs(traj.x - ref.x).max(axis=1)
    out = {"state_sup": float(off.max()), "state_T": float(off[-1])}
    if ref.reaction is not None and traj.reaction.shape == ref.reaction.shape:
        out["reaction"] = float(np.abs(traj.reaction - ref.reaction).max())
    if made.unique and ref.impulse is not None:
        out |= _multipliers(made, traj) | errors_at_times(made, traj)
    if not made.unique and isinstance(made.case.problem, Complementarity):
        out["selection"], out["polyhedron"] = selection(made, traj)
    if ref.events is not None and (traj.events or "events" in traj.stats):
        found = event_errors(made.case.problem, traj.events, ref.events)
        out |= dict(zip(("event_time", "events_missed", "events_extra"), found, strict=True))
    return out


def _multipliers(made: MeasureContext, traj: Trajectory) -> dict:
    ref = made.ref
    p = made.case.problem
    t = made.case.t
    columns = columns_of(p, traj.contacts, ref.contacts)
    off = spread(p, traj.contacts, traj.impulse, columns) - spread(
        p, ref.contacts, ref.impulse, columns
    )
    step = np.abs(np.diff(off, axis=0))
    mean = (step / np.diff(t)[:, None]).max(axis=1, initial=0.0)
    return {
        "impulse": float(np.abs(off).max(initial=0.0)),
        "l1": float(step.sum()),
        "sup": float(mean.max()),
        "settled": float(mean[made.quiet].max()) if made.quiet.any() else float("nan"),
    }
