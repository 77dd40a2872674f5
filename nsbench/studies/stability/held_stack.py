"""A column of n discs that must stay still: what a method does to it in many steps.

The step is STEP / n: the floor carries n discs, and what one sweep leaves of the lowest contact is
about h n, a tenth of a radius, whatever n. Samples are far apart at first and one step apart in the
last JITTER_STEPS, so that single steps are seen.
"""

from __future__ import annotations

import numpy as np

from nsbench.case import get_case
from nsbench.solvers import solve

STEP = 0.1  # h n
JITTER_STEPS = 50
SAMPLES = 40  # before them
LATE = 0.5  # of the run, from which the drift is taken


def hold(n: int, steps: int, method: str) -> dict:
    """Hold a column of n discs for a number of steps; lengths in radii, g = 1, unit weights.

    sunk: largest displacement at the end. drift: change of the mean height per unit time in the
    second half. jitter: largest displacement in one of the last steps. energy: change of the
    potential energy over the run; rise: its largest increase between samples. sideways: largest
    displacement across.
    """
    h = STEP / n
    late = steps - JITTER_STEPS
    counts = np.unique(np.round(np.linspace(0, late, SAMPLES)).astype(int))
    t = h * np.concatenate((counts, np.arange(late + 1, steps + 1)))
    case = get_case("stack", n=n).replace(t=t)
    accuracy = {"h": h} if _has_step(method) else {}
    traj = solve(case, method, **accuracy)
    row = {"n": n, "steps": steps, "h": h, "method": method, "status": traj.status.code}
    row["why"] = "" if traj.status.ok else str(traj.status)
    if not len(traj.t) or not np.isfinite(traj.x).all():
        return row
    x = traj.x.reshape(len(t), n, 2)
    heights = x[..., 1].mean(axis=1)
    half = int(np.searchsorted(t, LATE * t[-1]))
    energy = x[..., 1].sum(axis=1)
    single = np.abs(np.diff(x[-JITTER_STEPS - 1 :], axis=0))
    return row | {
        "sunk": float(np.abs(x[-1] - x[0]).max()),
        "drift": float((heights[-1] - heights[half]) / (t[-1] - t[half])),
        "jitter": float(single.max()),
        "energy": float(energy[-1] - energy[0]),
        "rise": float(max(0.0, np.diff(energy).max())),
        "sideways": float(np.abs(x[..., 0] - x[:1, :, 0]).max()),
    }


def _has_step(method: str) -> bool:
    from nsbench.solvers import get

    return get(method).accuracy == "h"
