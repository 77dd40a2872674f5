"""Fill the chart layouts of the page with data: Vega-Lite specifications for study and trajectory.

Every function returns a Vega-Lite specification that stands alone: notebooks show it, and
nsbench.report.charts.files writes it as SVG, PDF or JSON.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from nsbench.report.charts.bar_texts import describe_bars
from nsbench.report.charts.coincidence import REACH, name_together
from nsbench.report.charts.files import with_data
from nsbench.report.charts.layouts import (
    METRICS,
    Spec,
    curve_chart,
    error_chart,
    order_chart,
    without_bar_tips,
)
from nsbench.report.data import Data, Runs, read
from nsbench.report.panel_choice import STEP_LABEL
from nsbench.report.style import Look, assign_looks, format_number
from nsbench.report.summary import summarise
from nsbench.trajectory import Trajectory

HOW_TO_BUILD = "`nsbench.run(..., references=FOLDER)` builds one first"
TITLES = {
    "state": "state error",
    "force": "error of the multipliers",
    "violation": "violation max(-g)",
    "selection": "selection of the multipliers",
}
MAX_POINTS = 400  # of one curve over time


def work_precision(
    study: object,
    case: str | None = None,
    metric: str = "state",
    highlight: str = "",
    beside: str | Path = "",
) -> Spec:
    """Chart errors against the seconds of the runs.

    study: whatever nsbench.write_report takes. case: its key; by default the only one of the
    study. metric: state, force (impulse, or reaction where that is compared), violation
    or selection. highlight: a method that keeps its colour; all others are a grey background.
    beside: a folder of results, such as those of a released version, whose methods are drawn too
    where the study has not run them. Raises ValueError for a case, metric or method that is not
    there.
    """
    data = _with_results(read(study), beside)
    return _errors(data, case, metric, ("seconds", "seconds of the run"), highlight)


def error_against_step(
    study: object,
    case: str | None = None,
    metric: str = "state",
    highlight: str = "",
    beside: str | Path = "",
) -> Spec:
    """Chart errors against the step; arguments as in work_precision."""
    return _errors(
        _with_results(read(study), beside), case, metric, ("h", STEP_LABEL), highlight
    )


def _with_results(data: Data, folder: str | Path) -> Data:
    """Add the methods of a folder of results that the study lacks, on the cases that it has."""
    if not folder:
        return data
    other = read(Path(folder))
    cases = set(data.case_keys)
    more = {k: r for k, r in other.runs.items() if k[0] in cases and k not in data.runs}
    return replace(data, runs={**data.runs, **more})


def orders(study: object, metric: str = "state") -> Spec:
    """Chart the orders of convergence with their 95 % intervals, a line per case."""
    if metric not in ("state", "force", "violation"):
        raise ValueError(f"there is no order of {metric!r}: state, force or violation")
    data = read(study)
    points = []
    for (case, solver), summary in summarise(data).items():
        order = getattr(summary, metric)
        if order.kind == "fit":
            low, high = order.interval
            ends = {"x": order.order, "low": low, "high": high}
            points.append({"case": case, "method": solver, "verdict": order.verdict, **ends})
    title = f"order of convergence of the {TITLES[metric]}"
    used = {p["method"] for p in points}
    cases = len({p["case"] for p in points})
    return with_data(order_chart(_methods(data, used), title, cases), points)


def trajectory(traj: Trajectory, what: str = "state") -> Spec:
    """Chart a trajectory over time: its coordinates (what = "state") or its impulses ("impulse").

    An impulse is the integral of a multiplier from the start. Raises ValueError for another word.
    """
    columns = {
        "state": (traj.x, [f"x{i}" for i in range(traj.x.shape[1])], "state x"),
        "impulse": (traj.impulse, [str(c) for c in traj.contacts], "impulse, integral of lambda"),
    }
    if what not in columns:
        raise ValueError(f"a trajectory has no {what!r} to plot: state or impulse")
    values, names, title = columns[what]
    kept = np.unique(np.linspace(0, len(traj.t) - 1, min(len(traj.t), MAX_POINTS)).astype(int))
    points = [
        {"series": name, "t": float(traj.t[k]), "y": float(values[k, j])}
        for j, name in enumerate(names)
        for k in kept
        if np.isfinite(values[k, j])
    ]
    return with_data(curve_chart(title), points)


def _errors(data: Data, case, metric: str, axis: tuple[str, str], highlight: str) -> Spec:
    """Chart the errors of one case over a column; axis: its name and its title."""
    x, title = axis
    if metric not in TITLES:
        raise ValueError(f"there is no metric {metric!r}: {', '.join(TITLES)}")
    if case is None and len(data.case_keys) == 1:
        case = data.case_keys[0]
    if case not in data.case_keys:
        raise ValueError(f"which case? The study has {', '.join(data.case_keys)}")
    found = data.of_case(case)
    by_reaction = any(runs.compared == "reaction" for runs in found)
    column = METRICS.get(metric, "reaction" if by_reaction else "impulse")
    points = [p for runs in found for p in _points(runs, column, x)]
    if not points and all(set(runs.col["reference"]) <= {"", "none"} for runs in found):
        why = (data.cases.get(case, {}).get("certificate") or {}).get("how") or HOW_TO_BUILD
        raise ValueError(f"nothing to draw: {case} has no reference and no errors; {why}")
    floor = max((runs.floor(column) for runs in found), default=0.0)
    name_together(points)
    errors = [p["y"] for p in points if p["kind"] in ("error", "level")]
    if errors and floor > 0.0:
        label = f"error of the reference, at most {format_number(floor)}"
        kind = "floor" if floor * REACH >= min(errors) else "far_floor"
        points.append({"kind": kind, "y": floor, "label": label})
    used = {p.get("method") for p in points}
    if highlight and highlight not in used:
        raise ValueError(f"{highlight!r} has no run of {case} to highlight")
    methods = _methods(data, used)
    if highlight:  # drawn last, on top of the others
        methods = [(s, look if s == highlight else Grey(look)) for s, look in methods]
        points.sort(key=lambda p: p.get("method") == highlight)
    spec = error_chart(methods, title, f"{TITLES[metric]}, {case}")
    kinds = {p["kind"] for p in points}
    kind = lambda layer: layer["transform"][0]["filter"]["equal"]
    spec["layer"] = [layer for layer in spec["layer"] if kind(layer) in kinds]
    if not any(p.get("bar", "none") != "none" for p in points):
        spec["layer"] = without_bar_tips(spec["layer"])
    return with_data(spec, points)


class Grey(Look):
    """The look of a method in the background: its marker and dashes, in grey."""

    def __init__(self, look: Look) -> None:
        super().__init__(look.index, look.tone, look.marker, look.line)

    @property
    def colour(self) -> str:
        """The grey of all methods in the background."""
        return "#c9c9c9"


def _methods(data: Data, used: set) -> list:
    """Pairs (name, look) of the methods used; looks are those of the whole study."""
    return [(s, look) for s, look in assign_looks(data.specs).items() if s in used]


def _points(runs: Runs, column: str, x: str) -> list[dict]:
    """Rows of an error chart, as in nsbench.report.charts.layouts.error_chart."""
    errors = np.abs(runs.col[column])
    bars = describe_bars(runs, column)
    good = runs.good & np.isfinite(errors)
    if x == "h" and runs.accuracy == "tol":
        some = np.where(good & (errors > 0), errors, np.inf)
        best = int(np.argmin(some))
        bar = bars[best] or "none"
        level = {"method": runs.solver, "kind": "level", "status": "ok", "bar": bar}
        return [{**level, "y": float(some[best])}] if np.isfinite(some[best]) else []
    out = []
    for k in np.flatnonzero(runs.col[x] > 0):
        status = runs.col["status"][k]
        point = {
            "method": runs.solver,
            "x": float(runs.col[x][k]),
            "h": float(runs.col["h"][k]),
            "status": status,
            "bar": bars[k] or "none",
        }
        if np.isfinite(runs.col["seconds"][k]):
            point["seconds"] = float(runs.col["seconds"][k])
        if good[k]:
            kind = "error" if errors[k] > 0 else "zero"
            out.append({**point, "kind": kind, "y": float(errors[k])})
        elif status != "refused" and not runs.good[k]:
            out.append({**point, "kind": "failed", "why": runs.col["why"][k]})
    return out
