"""Check: hard particles on a line that changed places, which no continuous motion allows."""

from __future__ import annotations

import numpy as np

from nsbench.case.scale import time_text
from nsbench.diagnostics.base import Finding
from nsbench.diagnostics.run_view import RunView
from nsbench.dynamics.contacts.constraint_set import ANCHOR, PAIR
from nsbench.dynamics.contacts.tolerances import scene_of
from nsbench.problem import Distance


def check_passed_through(run: RunView) -> Finding | None:
    """Find hard particles on a line that changed places, or that an anchor has passed through.

    A step was too long, or there was no room between them.
    """
    case = run.case
    traj = run.trajectory
    if not any(
        isinstance(c, Distance) and c.sign > 0 and c.dim == 1 for c in case.problem.constraints
    ):
        return None
    scene = scene_of(case)
    near = scene.all_static()
    for _, c, m in (family for family in scene.hard if family[1].dim == 1):
        line = traj.x[:, c.start : c.start + m]
        order = np.argsort(line[0])
        swapped = np.argwhere((np.diff(line[:, order]) < 0.0) & (np.diff(line[0, order]) > 0.0))
        if len(swapped):
            k, i = swapped[0]
            return _through(
                traj.t[k], f"particles {order[i]} and {order[i + 1]} have changed places"
            )
    for e in np.flatnonzero(np.isin(near.kind, (PAIR, ANCHOR)) & (near.sign > 0) & (near.dim == 1)):
        other = (
            traj.x[:, near.q[e]]
            if near.kind[e] == PAIR
            else np.array([scene.anchors(float(t))[near.q[e]] for t in traj.t])
        )
        side = traj.x[:, near.p[e]] - other
        if side[0] != 0.0 and (side * side[0] < 0.0).any():
            k = int(np.argmax(side * side[0] < 0.0))
            return _through(traj.t[k], f"the two of contact {near.ids[int(e)]} have changed places")
    return None


def _through(t: float, what: str) -> Finding:
    return Finding(
        "unverified",
        f"By t = {time_text(t, 6)} {what}, on a line, where nothing leads around: steps are too "
        "long, or "
        "there was no room between them.",
    )
