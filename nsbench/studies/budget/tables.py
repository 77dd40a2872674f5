"""Tables and figures of the study `budget`: costs per step and at equal error, model error."""

from __future__ import annotations

import numpy as np

from nsbench.report.style import format_number, format_power
from nsbench.studies.budget import costs
from nsbench.studies.curves import Curve, Panel, draw_panels
from nsbench.studies.finding import EvidenceFigure, EvidenceTable

FACTORS = (1.0, 2.0, 4.0, 10.0)  # of the performance profiles


def _name(entry: dict) -> str:
    return f"discs, N = {entry['scene']}" if entry["scene"].isdigit() else entry["scene"]


def steps_table(entries: list[dict]) -> EvidenceTable:
    """Tabulate one step of catching-up against one of PBD."""
    rows = [
        (
            _name(e),
            1e6 * e["step_ratio"]["pbd_step_seconds"],
            e["step_ratio"]["median"],
            e["step_ratio"]["low"],
            e["step_ratio"]["high"],
            e["step_ratio"]["inner_per_step"],
            _finite(costs.error_ratio(e)),
        )
        for e in entries
    ]
    return EvidenceTable(
        "steps",
        "One step at the same h",
        (
            "scene",
            "PBD step, microseconds",
            "catching-up over PBD",
            "quartiles from",
            "to",
            "inner iterations per QP step",
            "error of PBD over catching-up",
        ),
        tuple(rows),
        f"Interleaved rounds at spacing / {costs.SAME_STEP}; errors at the finest step of both.",
    )


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def seconds_table(entries: list[dict]) -> EvidenceTable:
    """Tabulate seconds at equal error and their ratios."""
    rows = []
    for e in entries:
        for target in costs.TARGETS:
            floor = 10.0 * e["truth_error"]
            pbd, qp = (costs.cost_at(e["rows"], m, target, floor) for m in costs.METHODS)
            rows.append(
                (
                    _name(e),
                    format_power(target),
                    _mark(pbd),
                    _mark(qp),
                    _finite(qp.seconds / pbd.seconds),
                )
            )
    return EvidenceTable(
        "seconds",
        "Seconds at equal error",
        ("scene", "state error", "PBD, s", "catching-up, s", "catching-up over PBD"),
        tuple(rows),
        "Above 1 PBD is the cheaper one. ~: extrapolated by order 1 from the finest run. None: the "
        "reference cannot tell, or a method does not yet converge at the steps tried.",
    )


def _mark(cost: costs.Cost) -> str | None:
    if not np.isfinite(cost.seconds):
        return None
    return f"{'~' * cost.extrapolated}{format_number(cost.seconds, 3)}"


def profile_table(entries: list[dict]) -> EvidenceTable:
    """Tabulate performance profiles of both methods."""
    rows = []
    for target in costs.TARGETS:
        shares = costs.profile(entries, target, FACTORS)
        rows += [(format_power(target), m, *shares[m]) for m in costs.METHODS if shares[m]]
    return EvidenceTable(
        "profiles",
        "Performance profiles",
        ("state error", "method", *(f"within {f:g}" for f in FACTORS)),
        tuple(rows),
        "Share of the scenes on which a method takes at most so many times the seconds of the "
        "cheaper one, extrapolated seconds included.",
    )


def model_table(model: dict) -> EvidenceTable:
    """Tabulate numerical errors of observables against their spread over seeds."""
    fields = ("observable", "method", "h", "mean", "spread", "rms", "largest")
    rest = ("ratio", "low", "high", "changed", "failed")
    return EvidenceTable(
        f"model-{model['r_hard']:g}",
        f"Epithelium, hard radius {model['r_hard']:g}: numerical error and spread over seeds",
        (
            "observable",
            "method",
            "h",
            "mean",
            "spread over seeds",
            "numerical error (rms)",
            "largest",
            "error / spread",
            "95 % from",
            "to",
            "seeds off by a half or more",
            "runs failed",
        ),
        tuple(tuple(r[f] for f in (*fields, *rest)) for r in model["rows"]),
        f"At {model['end']:g} h, {model['count']} seeds; the truth is known to "
        f"{format_number(model['truth_error'], 2)} (root mean square; "
        f"{format_number(model['worst_truth_error'], 2)} of the worst seed) in any coordinate. "
        "Spread: standard deviation. The interval is that of the deviation, for normal values, "
        "wider by what the truth is known to. No ratio where an observable varies by less.",
    )


def references_table(references: dict) -> EvidenceTable:
    """Tabulate errors against a reference of the same method and against the truth."""
    rows = [
        (r["method"], r["h"], r["self"], r["true"], r["self"] / r["true"] if r["true"] else None)
        for r in references["rows"]
    ]
    return EvidenceTable(
        "references",
        "What a reference of the same method hides",
        ("method", "h", "against PBD with h = 1e-3", "true", "ratio"),
        tuple(rows),
        f"Scene {references['case']}, largest error over all samples. That reference is itself "
        f"{format_number(references['own_error'], 3)} off; the true solution is known to "
        f"{format_number(references['truth_error'], 2)} ({references['truth']}).",
    )


def make_figures(discs: list[dict], references: dict) -> tuple[EvidenceFigure, ...]:
    """Draw error over seconds by number of discs, and both errors over the step."""
    panels = []
    for e in discs:
        curves = [
            Curve(m, *_columns([r for r in e["rows"] if r["method"] == m], "error", "seconds"))
            for m in costs.METHODS
        ]
        panels.append(Panel(_name(e), tuple(curves), "largest state error", "seconds"))
    curves = []
    for method in dict.fromkeys(r["method"] for r in references["rows"]):
        own = [r for r in references["rows"] if r["method"] == method]
        for kind, words in (("true", "true"), ("self", "against PBD")):
            curves.append(Curve(f"{method}, {words}", *_columns(own, "h", kind)))
    return (
        EvidenceFigure(
            "work",
            "Seconds over error of PBD and catching-up on free discs.",
            draw_panels(panels, columns=3),
        ),
        EvidenceFigure(
            "references",
            "Errors on the scene teaser against PBD with h = 1e-3 and against the true solution.",
            draw_panels([Panel("teaser", tuple(curves), "h", "largest state error")]),
        ),
    )


def _columns(rows: list[dict], x: str, y: str) -> tuple[list, list]:
    return [r[x] for r in rows], [r[y] for r in rows]
