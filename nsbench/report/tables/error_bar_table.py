"""Tabulate error bars, which are computed from a run alone, beside the errors of the same runs."""

from __future__ import annotations

import numpy as np

from nsbench.report.charts.bar_texts import KINDS, measurable
from nsbench.report.data import Runs
from nsbench.report.style import format_number
from nsbench.report.summary import Summary
from nsbench.report.tables.cells import Cell, Row, Table


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
        "be a fault."
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


def _range(runs: Runs, kind: str, quantity: str) -> Cell:
    """The range of the effectivities; a bound below the error is marked."""
    bar = runs.col[f"{kind}_{quantity}"]
    error = runs.col[f"{quantity}_norm"]
    seen = measurable(runs, quantity) & np.isfinite(bar)
    ratio = bar[seen] / error[seen]
    if not len(ratio):
        return Cell("no error to compare with", kind="quiet")
    low = float(ratio.min())
    digits = 3 if kind == "bound" else 2  # whether a bound is below 1 must be seen
    text = " to ".join(format_number(v, digits) for v in (low, float(ratio.max())))
    return Cell(text, kind="bad" if kind == "bound" and low < 1.0 else "number")
