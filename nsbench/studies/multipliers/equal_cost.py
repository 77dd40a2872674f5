"""What sweeps, orders, steps and warm starts buy at equal cost.

One sweep costs about what one step costs, so s sweeps with steps s times as long are as dear as one
sweep. A warm start pushes once along every kept contact, which costs about a sweep: s sweeps of
steps s + 1 times as long. Errors are the largest over the samples, against the true solution, and
those at the end.
"""

from __future__ import annotations

import numpy as np

from nsbench.studies.multipliers.warm_start import WARM, run_variant
from nsbench.studies.plateau.scenes import find_scene
from nsbench.studies.runs.finished_run import USABLE
from nsbench.studies.runs.ladders import context_of_truth

SWEEPS = (1, 2, 4, 16)
WARM_SWEEPS = (1, 3, 15)  # one more divides the cost
ORDERS = ("sorted", "reverse", "random")
ZERO = "zero"
KEPT = "kept"


def spend(key: str, sweeps_per_sample: int) -> list[dict]:
    """Run PBD with all divisions of the cost into steps and sweeps, in three orders.

    start: of the multipliers of a step, ZERO, or KEPT those of the last one.
    """
    case = find_scene(key)
    truth = context_of_truth(case).ref
    spacing = float(np.diff(case.t).min())
    divisions = [(ZERO, s, s) for s in SWEEPS] + [(KEPT, s, s + 1) for s in WARM_SWEEPS]
    out = []
    for order in ORDERS:
        for start, sweeps, cost in divisions:
            h = spacing / (sweeps_per_sample // cost)
            method = f"{WARM * (start == KEPT)}pbd[order={order},sweeps={sweeps}]"
            traj = run_variant(case, method, h)
            row = {"case": key, "order": order, "start": start, "sweeps": sweeps, "h": h}
            row |= {"status": traj.status.code, "state": None, "end": None, "reaction": None}
            if traj.status.code in USABLE:
                error = np.abs(traj.x - truth.x)
                row["state"] = float(error.max())
                row["end"] = float(error[-1].max())
                row["reaction"] = float(np.abs(traj.reaction - truth.reaction).max())
                row["projections"] = int(traj.stats.get("projections", 0))
            out.append(row)
    return out


def best_division(rows: list[dict], name: str, start: str = ZERO) -> dict:
    """Return the row of this start with the smallest error of this name."""
    own = [r for r in rows if r["start"] == start and r[name] is not None]
    return min(own, key=lambda r: r[name])
