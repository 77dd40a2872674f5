"""Errors of a run against the reference of its case, with the residuals beside them.

x, I, R are the state, the impulses (contacts are matched by id, one that is absent has none)
and the reaction of the run, x*, I*, R* those of the reference, i the samples, j the sample
intervals of length D_j, m_j = (I_{j+1} - I_j) / D_j the mean multiplier of an interval.

==================  ========================================================================
state_sup           max over i of |x - x*|_inf
state_T             |x - x*|_inf at the last sample
set_distance        distance of the samples from the set of all solutions (`Case.distance`);
                    in the place of state_sup where there are many
impulse             max over i and contacts of |I - I*|
reaction            max over i of |R - R*|_inf
l1                  sum over j and contacts of D_j |m_j - m*_j|
settled             max of |m_j - m*_j| outside windows of 2 sample spacings around the events
                    of the reference
sup                 max of |m_j - m*_j| over all j: a diagnostic, no order where m* jumps
lam_*, lam_floor    multipliers of single steps, see `measure.multiplier_times`
event_time,         see `event_errors`
events_missed, events_extra
bound_*, estimate_*  error bars without a reference, largest 2-norm over i (`nsbench.error_bars`):
                    bounds where they are proven, else estimates, NaN where there are none;
                    state_norm, reaction_norm: the errors in this norm
multipliers_unique  have the active gradients full rank along the reference? None without one
compared            "impulse" or "reaction": whose error tells of the multipliers; the reaction
                    where they are not unique, or the reference does not know them as well as it
                    (`Reference.knows_impulse`)
selection,          where gradients have not (impulse, l1, settled, sup are NaN there and the error
polyhedron          of the reaction stands in their place): distance of the multipliers to the
                    smallest element of the set of all (a selection, no error) and to the set
*_floor             ten times the reference's own error; errors below say nothing
*_scale             largest value of the reference, at least 1: what rounding is relative to
below               names of the errors that say nothing, see `below_reference`
reference           "closed form", "certified", "stored" or "none"
feasibility, sign, complementarity, residual: see `measure.residuals`
==================  ========================================================================
"""

from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.columns import MEASURED_GROUPS, names
from nsbench.measure.context import MeasureContext, context_of
from nsbench.measure.event_times import event_errors
from nsbench.measure.multiplier_sets import selection
from nsbench.measure.multiplier_times import errors_at_times
from nsbench.measure.residuals import no_residuals, residuals
from nsbench.problem import Complementarity
from nsbench.reference import columns_of, spread
from nsbench.trajectory import Trajectory

# statuses of runs that reached T
MEASURED = ("ok", "unverified", "degenerate", "below_reference")


def errors(case: Case, traj: Trajectory, context: MeasureContext | None = None) -> dict:
    """Measure the errors and residuals of one run; NaN where one has no meaning.

    The keys are described at the head of this module; units and labels: `nsbench.columns`. A run
    that did not reach T has residuals only. Whoever prints an error prints its floor. context: what
    to measure against in place of the case's own reference (`measure.context.make_context`).
    ValueError if the samples are not those of the case; BadReference (a ValueError) if the stored
    reference is unusable.
    """
    made = context_of(case) if context is None else context
    ref = made.ref
    out = dict.fromkeys(names(*MEASURED_GROUPS), float("nan"))
    out |= {
        "reference": "none" if ref is None else ref.kind,
        "multipliers_unique": made.unique,
        "compared": made.compared,
        "below": "",
    }
    if not len(traj.t):
        return out | no_residuals()
    if not np.array_equal(traj.t, case.t):
        raise ValueError(
            f"the run has {len(traj.t)} samples at times of its own; {case.key} has {len(case.t)}"
        )
    out |= residuals(made, traj) | _error_bars(traj)
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
        out |= _against(made, traj) | _norms(ref, traj)
        out["below"] = " ".join(below_reference(out, case.t))
    return out


def below_reference(row: dict, t: np.ndarray) -> list[str]:
    """List the errors in `row` that the reference's own error may have made.

    They lie below ten times what that error can make of them.
    """
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
    """Has the run a status that is measured to the end, with finite states and impulses?"""
    return traj.status.code in MEASURED and bool(
        np.all(np.isfinite(traj.x)) and np.all(np.isfinite(traj.impulse))
    )


def _error_bars(traj: Trajectory) -> dict:
    """Return the largest error bars over the samples, of runs that have any."""
    if traj.bound is None or not _finished(traj):
        return {}
    bars = traj.bound
    kind = "bound" if bars.is_proven else "estimate"
    return {
        f"{kind}_state": float(bars.state.max()),
        f"{kind}_reaction": float(bars.reaction.max()),
        "estimate_impulse": float(bars.impulse.max()),
        "lam_variation": bars.lam_variation,
    }


def _norms(ref, traj: Trajectory) -> dict:
    """Return the errors that error bars are compared with, of runs that have any."""
    if traj.bound is None:
        return {}
    out = {"state_norm": float(np.linalg.norm(traj.x - ref.x, axis=1).max())}
    if ref.reaction is not None and traj.reaction.shape == ref.reaction.shape:
        off = np.linalg.norm(traj.reaction - ref.reaction, axis=1)
        out["reaction_norm"] = float(off.max())
    return out


def _size(values) -> float:
    """Return the largest modulus of the values, at least 1; 1 if there are none."""
    return 1.0 if values is None else max(1.0, float(np.abs(values).max(initial=0.0)))


def _against(made: MeasureContext, traj: Trajectory) -> dict:
    """Measure the errors of a finished run against the reference."""
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
    """Measure the errors of unique multipliers: impulse, l1, sup and settled."""
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
