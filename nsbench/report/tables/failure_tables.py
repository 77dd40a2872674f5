"""Tabulate runs without a number, and failures over the seeds of a family."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable

from nsbench.report.data import Data, Runs
from nsbench.report.study_pages import StudySection, failures_of
from nsbench.report.style import (
    join_names,
)
from nsbench.report.summary import (
    count_finished,
    format_statuses,
)
from nsbench.report.tables.cells import Cell, Row, Table


NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")  # without the stop of a sentence


def failures_table(data: Data) -> Table:
    """Build the table of runs without a number, by status, method and sentence.

    Sentences that differ only in their numbers count as one, and refusals with the same sentence
    whichever methods say it.
    """
    groups: dict = {}
    for (case, solver), runs in data.runs.items():
        for status, why in zip(runs.col["status"], runs.col["why"], strict=True):
            if status in ("ok", "below_reference"):
                continue
            sentence = NUMBER.sub("#", why)
            refused = status == "refused"
            by = "" if refused else solver
            key = (refused, status or "without status", by, sentence)
            entry = groups.setdefault(key, {"runs": 0, "why": why, "cases": {}, "solvers": {}})
            entry["runs"] += 1
            entry["cases"][case] = None
            entry["solvers"][solver] = None
    rows = []
    for (refused, status, _, _), entry in sorted(
        groups.items(), key=lambda g: (g[0][:2], -g[1]["runs"], g[0])
    ):
        solvers = list(entry["solvers"])
        one = solvers[0] if len(solvers) == 1 else ""
        why = entry["why"] or "No sentence was recorded."
        rows.append(
            Row(
                (
                    Cell(status, kind="refused" if refused else "failed"),
                    Cell(one, kind="method") if one else Cell(join_names(solvers, 8)),
                    Cell(str(entry["runs"]), kind="number"),
                    Cell(why),
                    Cell(join_names(entry["cases"], 8)),
                ),
                solver=one,
            )
        )
    return Table(
        "failures",
        ("status", "method", "runs", "sentence", "cases"),
        tuple(rows),
        "Sentences that differ only in their numbers are counted together, refusals of several "
        "methods too; the first one is shown."
        if rows
        else "Every run attempted reached its end time with a number.",
    )


def study_failures_table(studies: Iterable[StudySection]) -> Table:
    """Build the table of cells of studies that did not end well, by study, status and method.

    Sentences that differ only in their numbers count as one, as in `failures_table`.
    """
    groups: dict = {}
    for study in studies:
        for t in failures_of(study):
            at = [t.columns.index(name) for name in ("status", "method", "sentence")]
            for row in t.rows:
                status, method, why = (row.cells[k].text for k in at)
                key = (study.name, status, method, NUMBER.sub("#", why))
                groups.setdefault(key, [why, 0])[1] += 1
    rows = [
        Row((Cell(study), Cell(status, kind="failed"), Cell(method), _count(n), Cell(why)))
        for (study, status, method, _), (why, n) in groups.items()
    ]
    return Table(
        "study-failures",
        ("study", "status", "method", "cells", "sentence"),
        tuple(rows),
        "Each cell with its step and its sentence is in the table of its study." if rows else "",
    )


def _count(n: int) -> Cell:
    return Cell(str(n), kind="number")


def seeds_table(data: Data) -> Table:
    """Build the table of methods on families of cases that differ only in their seed."""
    groups: dict = {}
    for (case, solver), runs in data.runs.items():
        if re.search(r"[\[,]seed=", case):
            family = re.sub(
                r"\[\]$", "", re.sub(r"(?<=\[),", "", re.sub(r",?seed=[^,\]]*", "", case))
            )
            groups.setdefault((family, solver), []).append(runs)
    rows = []
    for (family, solver), group in groups.items():
        if len(group) < 2:
            continue
        failed = [r for r in group if count_finished(r) < len(r)]
        statuses = format_statuses(sum_statuses(failed)) if failed else "none"
        rows.append(
            Row(
                (
                    Cell(solver, kind="method"),
                    Cell(str(len(group)), kind="number"),
                    Cell(str(len(failed)), kind="number" if not failed else "bad"),
                    Cell(statuses),
                ),
                family,
                solver,
            )
        )
    return Table(
        "seeds",
        ("method", "seeds", "with a failure", "statuses"),
        tuple(rows),
        "A seed counts as failed when any of its runs ended without a number.",
    )


def sum_statuses(group: list[Runs]) -> Counter:
    """Count the statuses of all runs of a group without those whose errors are numbers."""

    total = Counter(s for r in group for s in r.col["status"].tolist())
    for code in ("ok", "below_reference"):
        total.pop(code, None)
    return total
