"""The true solution of any scene: what is known of it, else a computed one with a bound.

In this order: closed form or stored reference; two runs of the event-driven method; catching-up
with steps h, h/2, h/4, extrapolated: x* = 2 x(h/4) - x(h/2), of which the distance to
2 x(h/2) - x(h) is the bound. Bounds of computed references are differences of two runs, times
SAFETY: estimates, not proofs.
"""

from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.reference import Reference, columns_of, reference, spread
from nsbench.solvers import get, solve
from nsbench.studies.runs.finished_run import USABLE, finish
from nsbench.trajectory import Trajectory

SAFETY = 10.0  # of the difference of two runs, for what both share
LOOSER = 1e-8  # tolerance of the second run of the event-driven method
EXTRAPOLATION_SUBSTEPS = 64  # steps between two samples of the coarsest of three runs


def find_truth(case: Case, substeps: int = EXTRAPOLATION_SUBSTEPS) -> Reference:
    """Return the known reference of a case, or a computed one.

    substeps: of the coarsest run that is extrapolated. Raises ArithmeticError where none of the
    methods ends well.
    """
    known = reference(case)
    if known is not None:
        return known
    return follow_events(case) or extrapolate(case, substeps)


def follow_events(case: Case) -> Reference | None:
    """Return the solution of the event-driven method; None where it is refused or fails."""
    if get("event_driven").refuses(case):
        return None
    fine = solve(case, "event_driven")
    coarse = solve(case, "event_driven", tol=LOOSER)
    if not (fine.status.ok and coarse.status.ok):
        return None
    how = f"event_driven, against itself at {LOOSER:g}"
    return _compare(case, _values(fine), _values(coarse), fine, how)


def extrapolate(case: Case, substeps: int = EXTRAPOLATION_SUBSTEPS) -> Reference:
    """Return catching-up extrapolated from three steps. Raises ArithmeticError where it fails."""
    spacing = float(np.diff(case.t).min())
    runs = [
        finish(case, "catching_up", spacing / (substeps * 2**k), allowed=USABLE) for k in range(3)
    ]
    columns = columns_of(case.problem, *(traj.contacts for traj in runs))
    coarse, middle, fine = (_values(traj, case, columns) for traj in runs)
    best = {k: 2.0 * fine[k] - middle[k] for k in fine}
    other = {k: 2.0 * middle[k] - coarse[k] for k in fine}
    how = f"catching_up extrapolated from {substeps} to {4 * substeps} steps per sample"
    return _compare(case, best, other, runs[-1], how, tuple(columns))


def _values(traj: Trajectory, case: Case | None = None, columns: dict | None = None) -> dict:
    impulse = traj.impulse
    if columns is not None:
        impulse = spread(case.problem, traj.contacts, traj.impulse, columns)
    return {"x": traj.x, "impulse": impulse, "reaction": traj.reaction}


def _compare(case, best, other, traj, how, contacts=None) -> Reference:
    """Build the reference from the better values; its bounds are their distance to the others."""
    size = 1e-12 * max(1.0, float(np.abs(best["x"]).max()))
    bounds = {}
    for name in ("x", "impulse", "reaction"):
        same = best[name].shape == other[name].shape
        off = np.abs(best[name] - other[name]).max(initial=0.0) if same else np.inf
        bounds[name] = SAFETY * float(off) + size
    return Reference(
        t=case.t,
        x=best["x"],
        contacts=traj.contacts if contacts is None else contacts,
        impulse=best["impulse"],
        reaction=best["reaction"],
        events=tuple(traj.events) if "events" in traj.stats else None,
        state_error=bounds["x"],
        impulse_error=bounds["impulse"],
        reaction_error=bounds["reaction"],
        kind="computed",
        how=how,
        event_error=size,
    )
