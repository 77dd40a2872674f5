"""Choose the panels that a case gets, from its rows: errors over the step, and work-precision."""

from __future__ import annotations

import numpy as np

from nsbench.report.cost import counted_inner_work
from nsbench.report.data import Runs
from nsbench.report.style import Look
from nsbench.report.summary import Summary
from nsbench.report.svg_plots import Line, Panel

ROUNDING = 1e-11  # an error that stays below it at all steps shows rounding, not a method
STEP_LABEL = "step h (or 1/k)"


def case_panels(
    runs: list[Runs], looks: dict[str, Look], summaries: dict[tuple, Summary]
) -> list[Panel]:
    """Build the panels of one case that have something to show, in reading order.

    They show state error, multiplier error (of the reaction where multipliers are not unique),
    violation, and the selection or the multiplier away from events, over the step.
    """
    mine = [summaries[r.case, r.solver] for r in runs]
    force = mine[0].force.metric if mine else "impulse"
    unique = all(r.unique for r in runs)
    doubt = "nearly not" if unique else "not"
    titles = {
        "impulse": "Impulse error",
        "reaction": f"Reaction error (multipliers are {doubt} unique)",
    }
    out = [
        Panel(
            "state",
            "State error",
            STEP_LABEL,
            _against_h(runs, looks, "state_sup"),
            _floor(runs, "state_sup"),
            _claims(mine, "state"),
        ),
        Panel(
            "multiplier",
            titles[force],
            STEP_LABEL,
            _against_h(runs, looks, force),
            _floor(runs, force),
            _claims(mine, "force"),
        ),
        Panel(
            "violation",
            "Violation max(-g)",
            STEP_LABEL,
            _against_h(runs, looks, "feasibility"),
            0.0,
            (1.0,) if any(s.violation.kind == "fit" for s in mine) else (),
        ),
    ]
    out.append(_last_panel(runs, looks, mine, force))
    return [p for p in out if any(line.y.size or line.level > 0 for line in p.lines)]


def _last_panel(runs: list[Runs], looks: dict[str, Look], mine: list[Summary], force: str) -> Panel:
    """The selection where multipliers are not unique, else the multiplier away from events."""
    if force == "reaction":
        lines = _against_h(runs, looks, "selection", False)
        return Panel("selection", "Selection: not an error", STEP_LABEL, lines)
    lines = _against_h(runs, looks, "settled")
    claims = _claims(mine, "force")
    return Panel("settled", "Multiplier away from events", STEP_LABEL, lines, 0.0, claims)


def cost_panels(runs: list[Runs], looks: dict[str, Look]) -> list[Panel]:
    """Build the work-precision diagrams of one case.

    They show the state error over seconds, right-hand sides, and projections or inner iterations.
    """
    floor = _floor(runs, "state_sup")
    out = [
        Panel(
            "seconds",
            "State error against seconds",
            "seconds of the run (open markers: host loop)",
            _against(runs, looks, lambda r: r.col["seconds"]),
            floor,
        ),
        Panel(
            "rhs",
            "Against right-hand sides",
            "drift calls",
            _against(runs, looks, lambda r: r.col["drift_calls"]),
            floor,
        ),
        Panel(
            "inner",
            "Against projections or inner iterations",
            "projections + inner iterations (or QP solves)",
            _against(runs, looks, counted_inner_work),
            floor,
        ),
    ]
    return [p for p in out if any(line.y.size for line in p.lines)]


def _floor(runs: list[Runs], metric: str) -> float:
    """Largest floor of the reference over all runs."""
    return max((r.floor(metric) for r in runs), default=0.0)


def _claims(mine: list[Summary], which: str) -> tuple[float, ...]:
    """List the distinct claimed orders, at most two: the slope guides of a panel."""
    fits = [o for o in (s.state if which == "state" else s.force for s in mine) if o.kind == "fit"]
    orders = {o.claim for o in fits}
    return tuple(sorted(float(p) for p in orders if p))[:2]


def _against_h(
    runs: list[Runs], looks: dict[str, Look], metric: str, failures: bool = True
) -> tuple[Line, ...]:
    """Lines of `metric` over the step taken.

    A method with a tolerance appears as the level of its best error. failures: mark failed runs.
    """
    out = []
    for r in runs:
        values = np.abs(r.col[metric])
        h = r.col["h"]
        use = r.good & np.isfinite(values) & (h > 0)
        none = np.empty(0)
        if r.accuracy == "tol":
            if use.any():
                out.append(
                    Line(r.solver, looks[r.solver], none, none, none, float(values[use].min()))
                )
            continue
        refused = np.isin(r.col["status"], ("refused",))
        failed = np.unique(h[~r.good & ~refused & (h > 0)]) if failures else none
        if use.any() or failed.size:
            rounding = bool(use.any() and values[use].max() < ROUNDING)
            out.append(Line(r.solver, looks[r.solver], h[use], values[use], failed, far=rounding))
    return tuple(out)


def _against(runs: list[Runs], looks: dict[str, Look], cost) -> tuple[Line, ...]:
    """Lines of the state error over a cost; markers are open where the loop is not compiled."""
    out = []
    for r in runs:
        x = cost(r)
        y = np.abs(r.col["state_sup"])
        use = r.good & np.isfinite(x) & (x > 0) & np.isfinite(y)
        if use.any():
            out.append(
                Line(
                    r.solver,
                    looks[r.solver],
                    x[use],
                    y[use],
                    np.empty(0),
                    hollow=r.loop == "host",
                    far=r.accuracy == "tol",
                )
            )
    return tuple(out)
