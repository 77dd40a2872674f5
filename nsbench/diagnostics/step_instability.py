"""Check: fixed steps beyond the stability limit of an explicit method.

An explicit step h multiplies what decays with rate r by 1 - r h, which grows beyond r h = 2
(Hairer & Wanner, Solving Ordinary Differential Equations II, section IV.2).
"""

from __future__ import annotations

import numpy as np

from nsbench.case.scale import size_text, span_text, time_text
from nsbench.compilation.factories import as_numpy
from nsbench.diagnostics.base import Finding
from nsbench.diagnostics.run_view import RunView

GROWTH = 10.0  # of the largest coordinate, over that of the start and of half of the samples
STABILITY_LIMIT = 2.0  # of r h


def check_step_instability(run: RunView) -> Finding | None:
    """Find a state that grew although the drift points back: the steps overshoot.

    Checked at the sample with the largest coordinate, where the drift times the step is more than
    twice the coordinate, and against it.
    """
    h = run.resolution.step
    traj = run.trajectory
    sizes = np.abs(traj.x).max(axis=1, initial=0.0)
    k = int(np.argmax(sizes))
    if not (h > 0.0 and sizes[k] > GROWTH * max(sizes[0], float(np.median(sizes)))):
        return None
    i = int(np.argmax(np.abs(traj.x[k])))
    f = as_numpy(run.case.problem.drift)(traj.t[k], traj.x[k].copy())
    if not -f[i] * h * np.sign(traj.x[k, i]) > STABILITY_LIMIT * sizes[k]:
        return None
    return Finding(
        "diverged",
        f"The state grew to {size_text(sizes[k])} at t = {time_text(traj.t[k], 6)} although the "
        "drift pulls it "
        f"back: steps of {span_text(h)} overshoot; take them shorter than "
        f"{span_text(STABILITY_LIMIT * sizes[k] / abs(f[i]))}.",
    )
