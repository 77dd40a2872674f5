"""Checks: hard particles that changed places on a line, or are about to pass through each other."""

from __future__ import annotations

import numpy as np

from nsbench.case.scale import time_text
from nsbench.diagnostics.base import Finding
from nsbench.diagnostics.run_view import RunView
from nsbench.dynamics.contacts.constraint_set import ANCHOR, PAIR
from nsbench.dynamics.contacts.tolerances import scene_of
from nsbench.dynamics.scaling.estimate import particle_diameter
from nsbench.problem import Distance

DEEP = 0.5  # of the distance that two particles keep


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


def check_deep_overlap(run: RunView) -> Finding | None:
    """Find hard particles that are less than half as far apart as they must be.

    A step or two further they have passed through one another, in the plane without a trace. Those
    that overlap so at the start may do so no more than there.
    """
    suspects = np.flatnonzero(run.violations > DEEP * particle_diameter(run.case))
    if not suspects.size:
        return None
    allowed = max(DEEP, _deepest(run, 0)[0])
    for k in suspects[suspects > 0]:
        depth, contact = _deepest(run, int(k))
        if depth > allowed:
            return Finding(
                "unverified",
                f"At t = {time_text(run.trajectory.t[k], 6)} the particles of contact {contact} "
                f"are at {max(0.0, 1.0 - depth):.2g} of the distance that they keep: steps are "
                "too long, or springs too soft, for particles of this size.",
            )
    return None


def _deepest(run: RunView, k: int) -> tuple[float, tuple]:
    """Return the deepest overlap of hard particles at sample k, relative to the distance that they
    keep, and the contact: 0.0 and () without one."""
    scene = scene_of(run.case)
    t = float(run.trajectory.t[k])
    x = run.trajectory.x[k]
    near = scene.near(x, 0.0, t)
    hard = np.flatnonzero(np.isin(near.kind, (PAIR, ANCHOR)) & (near.sign > 0) & (near.d > 0.0))
    if not hard.size:
        return 0.0, ()
    depths = -scene.gaps(t, x, near)[hard] / near.d[hard]
    worst = int(depths.argmax())
    return float(depths[worst]), near.ids[int(hard[worst])]
