"""Status of a step of a smooth arc that failed: diverged, not finite, or not smooth."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nsbench.case.scale import size_text, time_text
from nsbench.trajectory import Status

GROWTH = 1e6  # times its size at the start of the arc: a state beyond has diverged
AHEAD = 1e-9  # of the rest of the arc: a right-hand side that is not finite so soon ends it


def failed_step(rhs: Callable, t: float, y: np.ndarray, t_end: float, start_size: float) -> Status:
    """Describe why a step from (t, y (n,)) failed; t_end, start_size: of the arc."""
    if np.abs(y).max(initial=0.0) > GROWTH * start_size:
        return Status(
            "diverged", f"The state grew to {size_text(np.abs(y).max())} at t = {time_text(t)}."
        )
    ahead = t + AHEAD * (t_end - t)
    if not np.all(np.isfinite(rhs(ahead, y + (ahead - t) * rhs(t, y)))):
        return Status("nan", f"The right-hand side is not finite after t = {time_text(t)}.")
    return Status(
        "degenerate",
        f"The step size fell below rounding at t = {time_text(t)}: the solution is not smooth, "
        "or the equation too stiff for this method.",
    )
