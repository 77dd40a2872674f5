"""Chart of a trajectory: its coordinates, or cumulative multipliers, over time."""

from __future__ import annotations

import numpy as np

from nsbench.plots.chart import Chart, chart_of
from nsbench.report.charts.layouts import curve_chart
from nsbench.trajectory import Trajectory

MAX_CURVES = 12  # more cannot be told apart by colour
TITLES = {
    "x": "state",
    "impulse": "cumulative multiplier",
    "reaction": "cumulative reaction",
}


def plot_trajectory(traj: Trajectory, what: str = "x") -> Chart:
    """Draw the coordinates of a trajectory over time; what: "x", "impulse" or "reaction".

    Of more than MAX_CURVES curves those are drawn that move most. Raises ValueError for another
    word, and for a run without samples.
    """
    if what not in TITLES:
        raise ValueError(f"what is {what!r}; one of {', '.join(TITLES)}")
    values = np.asarray(getattr(traj, what), float)
    if not values.size:
        raise ValueError(f"nothing to draw: the run has no {TITLES[what]} ({traj.status})")
    rows = []
    for k in largest_motion(values):
        name = f"contact {traj.contacts[k]}" if what == "impulse" else f"{what}[{k}]"
        known = np.isfinite(values[:, k])
        points = zip(traj.t[known], values[known, k], strict=True)
        rows += [{"series": name, "t": float(t), "y": float(y)} for t, y in points]
    return chart_of(curve_chart(TITLES[what]), rows)


def largest_motion(values: np.ndarray) -> list[int]:
    """Return the columns of values (k, n) that move most, at most MAX_CURVES, in their order."""
    with np.errstate(invalid="ignore"):
        span = np.nan_to_num(np.nanmax(values, axis=0) - np.nanmin(values, axis=0))
    chosen = np.argsort(-span, kind="stable")[:MAX_CURVES]
    return sorted(int(k) for k in chosen)
