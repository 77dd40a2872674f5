"""Discs that must stay still: what a method does to a column or a pile of them in many steps.

A column is `rows` discs on a floor. A pile is a triangle of them between two walls: `rows` discs on
the floor, that touch each other and the walls, and rows of one less each in the gaps. Both rest:
contact forces lambda >= 0 with sum lambda_k grad g_k = -f exist. In a pile a disc in a gap is
carried by two below, and what pushes sideways goes into the walls; the floor row can be stressed at
will, so that multipliers are not unique there, and motion alone is measured.

The step is STEP / rows, or a part of it: the floor carries as many discs above one another, and
what one sweep leaves of the lowest contact is about h rows, a tenth of a radius, whatever the
height. Samples are far apart at first and one step apart in the last JITTER_STEPS, so that single
steps are seen.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from nsbench.solvers import solve
from nsbench.studies.plateau.scenes import find_scene

COLUMN = "stack[n={0:d}]"
PILE = "stack[n={0:d},columns={0:d},shape=pile]"
STEP = 0.1  # h rows
JITTER_STEPS = 50
SAMPLES = 40  # before them
LATE = 0.5  # of the run, from which the drift is taken
TOUCH = 1e-9  # radii: gaps of contacts at the start
OVER = 1.0  # radii: half of the distance to the next place of a row


def hold(key: str, rows: int, steps: int, method: str, divisor: int = 1) -> dict:
    """Hold a scene at rest for a number of steps; lengths in radii, g = 1, unit weights.

    key: of a scene of discs in the plane, `rows` of them above one another. sunk: largest
    displacement at the end. drift: change of the mean height per unit time in the second half.
    jitter: largest displacement in one of the last steps. energy: change of the potential energy
    over the run; rise: its largest increase between samples. sideways: largest displacement across.
    toppled: discs that moved by more than OVER against one that they touched at the start. A run
    that did not reach its end has none of these, but its status and sentence; with 0 steps nothing
    is run and the status is empty. The step is h = STEP / (rows divisor).
    """
    h = STEP / (rows * divisor)
    case = find_scene(key)
    n = len(case.x0) // 2
    row = {"n": n, "rows": rows, "steps": steps, "h": h, "method": method}
    if not steps:
        return row | {"status": "", "why": "not held, for its cost"}
    late = steps - JITTER_STEPS
    counts = np.unique(np.round(np.linspace(0, late, SAMPLES)).astype(int))
    t = h * np.concatenate((counts, np.arange(late + 1, steps + 1)))
    accuracy = {"h": h} if _has_step(method) else {}
    traj = solve(case.replace(t=t), method, **accuracy)
    row |= {"status": traj.status.code, "why": "" if traj.status.ok else str(traj.status)}
    if len(traj.t) < len(t) or not np.isfinite(traj.x).all():
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
        "toppled": _count_toppled(x),
    }


def _count_toppled(x: np.ndarray) -> int:
    """Count discs that lost their place, from positions x (samples, discs, 2) in radii."""
    pairs = cKDTree(x[0]).query_pairs(2.0 + TOUCH, output_type="ndarray")
    apart = x[:, pairs[:, 0]] - x[:, pairs[:, 1]]
    moved = np.linalg.norm(apart - apart[0], axis=2).max(axis=0)
    return len(np.unique(pairs[moved > OVER]))


def _has_step(method: str) -> bool:
    from nsbench.solvers import get

    return get(method).accuracy == "h"
