"""Tabulate error bars, which are computed from a run alone, beside the errors of the same runs."""

from __future__ import annotations

import numpy as np

from nsbench.report.charts.bar_texts import KINDS, measurable
from nsbench.report.data import Runs
from nsbench.report.style import format_number
from nsbench.report.summary import Summary
from nsbench.report.tables.cells import Cell, Row, Table

MOST_NAMED = 4  # methods and cases, in the note


def error_bar_table(summaries: dict[tuple, Summary]) -> Table:
    """Build the table of error bars: kind, largest error and error bar of the finest run, and the
    range of the effectivities (error bar over error) over all runs of the ladder."""
    rows = []
    for (case, solver), s in summaries.items():
        kind = next((k for k in KINDS if np.isfinite(s.runs.col[f"{k}_state"]).any()), "")
        if s.word != "ok" or not kind:
            continue
        finest = int(np.nanargmin(np.where(s.runs.good, s.runs.col["h"], np.inf)))
        bar = float(s.runs.col[f"{kind}_state"][finest])
        rows.append(
            Row(
                (
                    Cell(solver, kind="method"),
                    Cell(kind),
                    Cell(format_number(float(s.runs.col["state_norm"][finest])), kind="number"),
                    Cell(format_number(bar), kind="number"),
                    _range(s.runs, kind, "state"),
                    _range(s.runs, kind, "reaction"),
                ),
                case,
                solver,
            )
        )
    note = (
        "Error bars are computed from a run alone: proven bounds for convex constraints with flat "
        "faces, estimates elsewhere, in the 2-norm and largest over the samples. The effectivity "
        "is error bar over error, over all runs whose error can be measured; a bound below 1 would "
        f"be a fault. {_too_small(summaries)}"
    )
    columns = (
        "method",
        "kind",
        "error at the finest step",
        "its error bar",
        "effectivity, state",
        "effectivity, reaction",
    )
    return Table("error_bars", columns, tuple(rows), note if rows else "")


def _effectivities(runs: Runs, kind: str, quantity: str) -> np.ndarray:
    """Error bar over error of the runs whose error can be measured."""
    bar = runs.col[f"{kind}_{quantity}"]
    error = runs.col[f"{quantity}_norm"]
    seen = measurable(runs, quantity) & np.isfinite(bar)
    return bar[seen] / error[seen]


def _too_small(summaries: dict[tuple, Summary]) -> str:
    """Name the methods and cases with estimates of the state below the error, worst first."""
    found = []
    count = total = 0
    for (case, solver), s in summaries.items():
        ratio = _effectivities(s.runs, "estimate", "state")
        total += len(ratio)
        count += int((ratio < 1.0).sum())
        if len(ratio) and ratio.min() < 1.0:
            found.append((float(ratio.min()), f"{solver} on {case}"))
    if not total:
        return ""
    if not count:
        return f"None of {total} estimates of the state is below the error."
    names = [f"{name} (down to {format_number(low)} times)" for low, name in sorted(found)]
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return (
        f"{count} of {total} estimates of the state are below the error: "
        f"{', '.join(names[:MOST_NAMED])}{more}."
    )


def _range(runs: Runs, kind: str, quantity: str) -> Cell:
    """The range of the effectivities; one below 1 is marked."""
    ratio = _effectivities(runs, kind, quantity)
    if not len(ratio):
        return Cell("no error to compare with", kind="quiet")
    low = float(ratio.min())
    digits = 3 if kind == "bound" else 2  # whether a bound is below 1 must be seen
    text = " to ".join(format_number(v, digits) for v in (low, float(ratio.max())))
    return Cell(text, kind="bad" if low < 1.0 else "number")
