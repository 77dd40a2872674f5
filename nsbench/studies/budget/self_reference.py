"""Errors of PBD against its own finest run beside its true errors, on the scene `teaser`.

Errors against PBD with a small step are compared with the true ones. What PBD's small step shares
with its larger ones cancels in the difference, and what it lacks is counted against any better
method.
"""

from __future__ import annotations

import numpy as np

from nsbench.case import get_case
from nsbench.solvers import solve
from nsbench.studies.runs.finished_run import USABLE
from nsbench.studies.runs.truth import find_truth

REFERENCE_STEP = 1e-3  # of PBD, as in the scene's source
STEPS = (0.1, 0.05, 0.02, 0.01, 0.005, 0.002)
METHODS = ("pbd", "pbd[order=reverse]", "catching_up")


def compare_references(seed: int = 0) -> dict:
    """Measure errors at the end and over all samples against both references.

    Returns the true error of the self-reference and rows {"method", "h", "self", "true"}; errors
    are the largest coordinate over all samples, None where a run failed.
    """
    case = get_case("teaser", seed=seed)
    truth = find_truth(case)
    own = solve(case, "pbd", h=REFERENCE_STEP)
    rows = []
    for method in METHODS:
        for h in STEPS:
            traj = solve(case, method, h=h)
            row = {"method": method, "h": h, "self": None, "true": None}
            if traj.status.code in USABLE:
                row["self"] = float(np.abs(traj.x - own.x).max())
                row["true"] = float(np.abs(traj.x - truth.x).max())
            rows.append(row)
    return {
        "case": case.key,
        "own_error": float(np.abs(own.x - truth.x).max()),
        "truth_error": truth.state_error,
        "truth": truth.kind,
        "rows": rows,
    }
