"""What sweeps, orders and steps buy at equal cost: the product of steps and sweeps is kept.

One sweep costs about what one step costs, so s sweeps with steps s times as long are as dear as one
sweep. Errors are the largest over the samples, against the true solution.
"""

from __future__ import annotations

import numpy as np

from nsbench.solvers import solve
from nsbench.studies.plateau.scenes import find_scene
from nsbench.studies.runs.ladders import context_of_truth
from nsbench.studies.runs.finished_run import USABLE

SWEEPS = (1, 2, 4, 16)
ORDERS = ("sorted", "reverse", "random")


def spend(key: str, sweeps_per_sample: int) -> list[dict]:
    """Run PBD with all divisions of the cost into steps and sweeps, in three orders."""
    case = find_scene(key)
    truth = context_of_truth(case).ref
    spacing = float(np.diff(case.t).min())
    out = []
    for order in ORDERS:
        for sweeps in SWEEPS:
            h = spacing / (sweeps_per_sample // sweeps)
            traj = solve(case, f"pbd[order={order},sweeps={sweeps}]", h=h)
            row = {"case": key, "order": order, "sweeps": sweeps, "h": h}
            row |= {"status": traj.status.code, "state": None, "reaction": None}
            if traj.status.code in USABLE:
                row["state"] = float(np.abs(traj.x - truth.x).max())
                row["reaction"] = float(np.abs(traj.reaction - truth.reaction).max())
                row["projections"] = int(traj.stats.get("projections", 0))
            out.append(row)
    return out


def best_division(rows: list[dict], name: str) -> dict:
    """Return the row with the smallest error of this name."""
    return min((r for r in rows if r[name] is not None), key=lambda r: r[name])
