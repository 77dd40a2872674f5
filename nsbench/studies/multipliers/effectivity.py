"""Effectivity of error bars: the largest error bar over the largest error, with a reference.

Errors that are rounding, or not ten times above what the reference is known to, give none.
"""

from __future__ import annotations

import numpy as np

from nsbench.case import get_case
from nsbench.reference import reference
from nsbench.solvers import get, solve
from nsbench.studies.runs.finished_run import USABLE

ROUNDING = 1e-9  # of the size of the state
KNOWN = 10.0  # times the bound of the reference


def measure_bars(key: str, method: str, divisors: tuple[int, ...]) -> list[dict]:
    """Measure effectivities of state and reaction at some steps; [] where there is no error.

    least: the smallest ratio of bar and error at any sample: below 1 the bar is no bound.
    """
    case = get_case(key)
    truth = reference(case)
    if truth is None or get(method).refuses(case):
        return []
    spacing = float(np.diff(case.t).min())
    out = []
    for n in divisors:
        traj = solve(case, method, h=spacing / n)
        if traj.status.code not in USABLE or traj.bound is None:
            continue
        error = np.linalg.norm(traj.x - truth.x, axis=1)
        size = max(1.0, float(np.abs(truth.x).max()))
        seen = error > KNOWN * truth.state_error + ROUNDING * size
        if not seen.any() or not np.isfinite(traj.bound.state).all():
            continue
        row = {
            "case": key,
            "method": method,
            "h": spacing / n,
            "kind": "bound" if traj.bound.is_proven else "estimate",
            "state": float(traj.bound.state.max() / error.max()),
            "least": float((traj.bound.state[seen] / error[seen]).min()),
            "reaction": None,
            "why": traj.bound.why,
        }
        if truth.reaction is not None:
            off = np.linalg.norm(traj.reaction - truth.reaction, axis=1)
            if off.max() > KNOWN * truth.reaction_error + ROUNDING * size:
                row["reaction"] = float(traj.bound.reaction.max() / off.max())
        out.append(row)
    return out
