"""Checks: contacts without a normal: coincident centres, and gradients that vanish.

Where a gradient vanishes a constraint does not push but throws: a projection divides by it. The
direction in which coincident centres part is no property of the case.
"""

from __future__ import annotations

import functools

import numpy as np

from nsbench.case import Case
from nsbench.case.scale import time_text
from nsbench.diagnostics.base import Finding
from nsbench.diagnostics.run_view import RunView
from nsbench.dynamics.contacts.constraint_set import ANCHOR, PAIR
from nsbench.dynamics.contacts.tolerances import scene_of
from nsbench.problem import Distance, Smooth

# gradient over its largest along the run: below it a constraint does not push but throws
VANISHING_GRADIENT = 1e-6


def check_coincident_centres(run: RunView) -> Finding | None:
    """Find coincident centres of hard particles at a start that is taken as it is.

    Their contact has no normal: the direction in which they part is no property of the case.
    """
    message = _coincident_centres(run.case)
    return Finding("degenerate", message) if message else None


@functools.lru_cache(maxsize=512)
def _coincident_centres(case: Case) -> str:
    """Name the first pair with coincident centres; "" if there is none."""
    if case.start != "keep" or not any(isinstance(c, Distance) for c in case.problem.constraints):
        return ""
    t = float(case.t[0])
    scene = scene_of(case)
    near = scene.near(case.x0, 0.0, t)
    g = scene.gaps(t, case.x0, near)
    tie = np.flatnonzero(np.isin(near.kind, (PAIR, ANCHOR)) & (near.sign > 0) & (g == -near.d))
    if not tie.size:
        return ""
    return (
        f"The start has coincident centres, {near.ids[int(tie[0])]}: their contact has no normal, "
        "and each method parts them in a direction of its own."
    )


def check_vanishing_gradient(run: RunView) -> Finding | None:
    """Find a smooth constraint that pushes where its gradient vanishes.

    The gradient is compared with its largest value along the run.
    """
    if not any(isinstance(c, Smooth) for c in run.case.problem.constraints):
        return None
    traj = run.trajectory
    scene = scene_of(run.case)
    acts = np.abs(np.diff(traj.impulse, axis=0)) > 0.0
    families = [k for k, c in enumerate(scene.families) if isinstance(c, Smooth)]
    for s, k in enumerate(families):
        columns = [(c, ident[1]) for c, ident in enumerate(traj.contacts) if ident[0] == k]
        if not columns:
            continue
        gradients = [
            np.asarray(scene.smooth(s).gradient(t, x)) for t, x in zip(traj.t, traj.x, strict=True)
        ]
        size = np.sqrt((np.array(gradients) ** 2).sum(-1))  # (samples, rows)
        for c, row in columns:
            smallest = np.minimum(size[:-1, row], size[1:, row])
            vanishes = smallest <= VANISHING_GRADIENT * np.nanmax(size[:, row])
            pushing = np.flatnonzero(acts[:, c] & vanishes)
            if pushing.size:
                return Finding(
                    "degenerate",
                    f"Constraint {(k, row)} pushes at t = {time_text(traj.t[pushing[0] + 1], 6)} "
                    "where its "
                    "gradient vanishes: there is no direction to push in.",
                )
    return None
