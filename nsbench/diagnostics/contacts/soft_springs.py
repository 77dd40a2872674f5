"""Check: springs in place of constraints that give way by a good part of the scene."""

from __future__ import annotations

import numpy as np

from nsbench.case.scale import size_text, span_text, time_text
from nsbench.diagnostics.base import Finding
from nsbench.diagnostics.run_view import RunView
from nsbench.dynamics.contacts.tolerances import scene_of

SOFT = 1.0  # of own length: a violation beyond which no constraint is held
SLOW = 16.0  # of own time: that in which a spring that pushes gives way, 1 / k


def check_soft_springs(run: RunView) -> Finding | None:
    """Find springs that hold no constraint: they give way by own length, or push while the time in
    which they give way, 1 / k, is many own times.

    The errors are then as large as the motion, and of no order in 1 / k. The start may violate
    constraints by itself.
    """
    k = run.resolution.stiffness
    if not k:
        return None
    worst = 1 + int(run.violations[1:].argmax())
    if not run.violations[worst] > 0.0:
        return None
    size = _gradient_of_worst(run, worst)
    depth = float(run.violations[worst]) / size
    k *= size**2  # the force of a gap g is k g times its gradient
    if not depth > (SOFT if SLOW * k > 1.0 else 0.0):
        return None
    return Finding(
        "unverified",
        f"Springs in place of constraints give way within 1 / k = {span_text(1.0 / k)}, and by "
        f"{size_text(depth)} at t = {time_text(run.trajectory.t[worst], 6)}, where the scene moves "
        f"within {span_text(1.0)}: no error of size 1 / k is claimed; take 1 / k below "
        f"{span_text(min(1.0, SOFT / depth) / max(k, 1.0))}.",
    )


def _gradient_of_worst(run: RunView, k: int) -> float:
    """Return the 2-norm of the gradient of the constraint that sample k violates most."""
    scene = scene_of(run.case)
    t = float(run.trajectory.t[k])
    x = run.trajectory.x[k]
    near = scene.near(x, 0.0, t)
    e = int(scene.gaps(t, x, near).argmin())
    size = float(np.linalg.norm(scene.dense_gradients(t, x, near)[e]))
    return size if size > 0.0 else 1.0
