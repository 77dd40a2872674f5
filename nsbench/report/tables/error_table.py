"""Table of every measured error and residual of every method, at its finest step.

The columns are those of GROUPS in nsbench.columns that hold a value in the study: a new error or
residual is in the table without an edit here.
"""

from __future__ import annotations

import numpy as np

from nsbench.columns import describe, names
from nsbench.report.data import Data, Runs
from nsbench.report.style import format_number
from nsbench.report.tables.cells import Cell, Row, Table

GROUPS = ("error", "selection", "residual")


def error_table(data: Data) -> Table:
    """Build the table: a row per case and method that has a finished run with an error."""
    finest = {key: _finest(runs) for key, runs in data.runs.items()}
    shown = [
        name
        for name in names(*GROUPS)
        if any(at is not None and _is_known(data.runs[key], name, at) for key, at in finest.items())
    ]
    rows = []
    for (case, solver), at in finest.items():
        runs = data.runs[case, solver]
        if at is None or not any(_is_known(runs, name, at) for name in shown):
            continue
        length = data.cases.get(case, {}).get("own_length")
        cells = (_cell(runs, name, at, length) for name in shown)
        rows.append(Row((Cell(solver, kind="method"), *cells), case, solver))
    note = (
        "Every error and residual that the bench measured, of the finest run of each method that "
        "ended with a number. “below” marks one that lies below what the reference's own error can "
        "make of it, “none” one that has no meaning for the case or the method. Residuals are "
        "computed from the samples alone: where a contact opens or closes within a sample "
        "interval, complementarity and equation keep a residual that no smaller step reduces, "
        "under methods with an error of 1e-12 too. Violations are in "
        "per cent as well where the case has a length of its own: the diameter of its particles, "
        "or the size that it states. Meanings and units are in the glossary at the end."
    )
    return Table(
        "errors",
        ("method", *(describe(name).title for name in shown)),
        tuple(rows),
        note if rows else "",
    )


def _finest(runs: Runs) -> int | None:
    """Index of the finished run with the smallest accuracy parameter; None without one."""
    h = np.where(runs.good & np.isfinite(runs.col["h"]), runs.col["h"], np.inf)
    return int(np.argmin(h)) if h.size and np.isfinite(h).any() else None


def _is_known(runs: Runs, name: str, at: int) -> bool:
    return bool(np.isfinite(runs.col[name][at]))


def _cell(runs: Runs, name: str, at: int, length: float | None) -> Cell:
    """One error, as “below” with its floor where it says nothing; a violation also in per cent."""
    if not _is_known(runs, name, at):
        return Cell("none", kind="quiet")
    value = float(runs.col[name][at])
    floor = runs.floor(name)
    if describe(name).floor and value < floor:  # residuals have none, and may be negative
        return Cell(f"< {format_number(floor)}", kind="number")
    if name in runs.col["below"][at].split():
        return Cell("below", kind="quiet")
    if describe(name).kind == "count":
        return Cell(str(int(value)), kind="number")
    if name != "feasibility" or not length:
        return Cell(format_number(value), kind="number")
    part = f"{format_number(100.0 * value / length)} %"
    return Cell(format_number(value), part, f"{part} of {format_number(length)}", "number")
