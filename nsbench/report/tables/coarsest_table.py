"""Tabulate how every method fares with the largest steps that the study has."""

from __future__ import annotations

from collections import Counter

import numpy as np

from nsbench.report.data import Data, Runs
from nsbench.report.style import format_number
from nsbench.report.summary import format_statuses
from nsbench.report.tables.cells import Cell, Row, Table
from nsbench.trajectory import NO_FAILURE


def coarsest_table(data: Data) -> Table:
    """Build the table by method of its coarsest runs, one of each case: how many failed, and the
    largest violations of the others, relative where the case has a length of its own."""
    found: dict[str, list[tuple[Runs, int]]] = {}
    for runs in data.runs.values():
        at = _coarsest(runs)
        if at is not None:
            found.setdefault(runs.solver, []).append((runs, at))
    rows = []
    for solver in (s for s in data.specs if s in found):
        statuses = Counter(str(runs.col["status"][at]) for runs, at in found[solver])
        failed = Counter({code: n for code, n in statuses.items() if code not in NO_FAILURE})
        rows.append(
            Row(
                (
                    Cell(solver, kind="method"),
                    Cell(str(len(found[solver])), kind="number"),
                    Cell(
                        str(failed.total()),
                        format_statuses(failed),
                        kind="bad" if failed else "number",
                    ),
                    _largest(data, found[solver], relative=True),
                    _largest(data, found[solver], relative=False),
                ),
                solver=solver,
            )
        )
    columns = (
        "method",
        "cases",
        "failed at the coarsest step",
        "largest violation there",
        "of cases without a length",
    )
    note = (
        "Of each case the run with the largest step or tolerance, or with the smallest k; refusals "
        "are left out. A state that grows without bounds has the status diverged. Violations are "
        "those of the runs that ended with a number, in per cent of the case's own length. Whether "
        "larger steps are stable no run of this study says: nsbench study stability goes further."
    )
    return Table("coarsest", columns, tuple(rows), note if rows else "")


def _coarsest(runs: Runs) -> int | None:
    """Index of the coarsest run that was not refused; None without one."""
    # a run of the penalty method that failed may have no step
    size = -runs.col["asked"] if runs.accuracy == "k" else runs.col["h"]
    kept = np.isfinite(size) & (runs.col["status"] != "refused")
    return int(np.argmax(np.where(kept, size, -np.inf))) if kept.any() else None


def _largest(data: Data, found: list[tuple[Runs, int]], relative: bool) -> Cell:
    """The largest violation of the cases with, or without, a length of their own."""
    known = []
    for runs, at in found:
        length = data.cases.get(runs.case, {}).get("own_length")
        violation = float(runs.col["feasibility"][at])
        if bool(length) == relative and runs.good[at] and np.isfinite(violation):
            known.append((violation / (length or 1.0), runs, at))
    if not known:
        return Cell("none known", kind="quiet")
    largest, runs, at = max(known, key=lambda one: one[0])
    if largest <= 0.0:
        return Cell("0", kind="number")
    text = f"{format_number(100 * largest)} %" if relative else format_number(largest)
    return Cell(text, f"{runs.case}, {_setting(runs, at)}", kind="number")


def _setting(runs: Runs, at: int) -> str:
    value = runs.col["asked" if runs.accuracy == "k" else "h"][at]
    return f"{runs.accuracy} = {format_number(float(value))}"
