"""Table for the terminal at the end of `nsbench run`: per case the best method, its error and cost.

Best is the cheapest method that reaches the state error TARGET, or whose order tells that a smaller
step than it was given would, in fewer seconds ("extrapolated"); where no error is known, or none is
small enough, the line says so.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from nsbench.report.cost import (
    Cost,
    cheaper_extrapolated,
    cheapest,
    format_setting,
    rank_costs,
)
from nsbench.report.data import Data, Runs
from nsbench.report.style import format_count, format_seconds
from nsbench.report.summary import (
    estimate_order,
    format_error,
    rounding_span,
    stored_claims,
    summarise,
)
from nsbench.trajectory import NO_FAILURE

TARGET = 1e-3  # state error that the best method reaches
MAX_LINES = 10
COUNTS = ("refused", "unverified", "failed")
HEAD = ("case", f"best at {TARGET:g}", "seconds", "order", "multipliers", *COUNTS)
NOT_KNOWN = "not known"
NOT_REACHED = "not reached"


@dataclass(frozen=True)
class Line:
    """One case: its best method with setting, seconds, order and error of the multipliers.

    seconds: NaN where no method is best. refused, unverified, failed: numbers of methods that
    refuse the case, of runs whose error is not certain, and of runs that ended with a failure.
    """

    case: str
    best: str
    setting: str
    seconds: float
    order: str
    multipliers: str
    refused: int
    unverified: int
    failed: int

    def cells(self) -> tuple[str, ...]:
        """Return the cells of the table."""
        best = f"{self.best} ({self.setting})" if self.setting else self.best
        seconds = format_seconds(self.seconds) if self.seconds > 0 else "-"
        counts = (str(getattr(self, name)) for name in COUNTS)
        return (self.case, best, seconds, self.order, self.multipliers, *counts)


def overview(data: Data, cases: Iterable[str] | None = None) -> list[Line]:
    """Return a line for each case (None: for all)."""
    return [_line(data, case) for case in (data.case_keys if cases is None else cases)]


def _line(data: Data, case: str) -> Line:
    runs = data.of_case(case)
    statuses = [s for r in runs for s in r.col["status"]]
    refused = sum(set(r.col["status"]) == {"refused"} for r in runs)
    failed = sum(s not in NO_FAILURE for s in statuses)
    counts = refused, statuses.count("unverified"), failed
    ranked = rank_costs(data, case, TARGET)
    further = _further(data, runs, ranked)
    if further is not None:
        setting = f"{format_setting(further)}, extrapolated"
        seconds = further.seconds
        return Line(case, further.solver, setting, seconds, "-", "-", *counts)
    if not ranked:
        measured = any(np.isfinite(r.col["state_sup"][r.good]).any() for r in runs)
        best = NOT_REACHED if measured else NOT_KNOWN
        if refused == len(runs):
            best = "refused"
        return Line(case, best, "", math.nan, "-", "-", *counts)
    first = cheapest(ranked)
    chosen = next(r for r in runs if r.solver == first.solver)
    return Line(
        case,
        first.solver,
        format_setting(first),
        first.seconds,
        _order(data, chosen),
        _multipliers(chosen),
        *counts,
    )


def _further(data: Data, runs: list[Runs], ranked: list[Cost]) -> Cost | None:
    """Return the extrapolated cost at which TARGET would be reached in fewer seconds than by any
    method that does."""
    seconds = cheapest(ranked).seconds if ranked else math.inf
    reached = {c.solver for c in ranked}
    some = {
        (r.case, r.solver): r
        for r in runs
        if r.solver not in reached and _finest_seconds(r) < seconds  # finer steps take longer
    }
    summaries = summarise(replace(data, runs=some)).values()
    return cheaper_extrapolated(summaries, ranked, TARGET)


def _finest_seconds(runs: Runs) -> float:
    """Return the seconds of the finest run that ended well, inf where none has an error."""
    good = runs.good & np.isfinite(runs.col["state_sup"]) & (runs.col["h"] > 0.0)
    return float(runs.col["seconds"][good][-1]) if good.any() else math.inf


def _order(data: Data, runs: Runs) -> str:
    """Return the order of the state error in the words of the report."""
    from nsbench.measure import fit_order

    fit = functools.partial(fit_order, span=rounding_span(data, runs.case, runs.solver))
    claims = stored_claims(data, runs.solver)
    return estimate_order(runs, "state_sup", claims, fit).text


def _multipliers(runs: Runs) -> str:
    """Return the smallest error of the impulses, or of the reaction where these are not unique."""
    for name in ("impulse", "reaction"):
        values = runs.col[name][runs.good]
        known = values[np.isfinite(values)]
        if known.size:
            word = "" if name == "impulse" else "reaction "
            return f"{word}to {format_error(float(known.min()), runs.floor(name))}"
    return NOT_KNOWN


def format_overview(data: Data) -> list[str]:
    """Return the table as lines of aligned cells: at most MAX_LINES cases, the rest as a count."""
    keys = data.case_keys
    shown = keys if len(keys) <= MAX_LINES else keys[: MAX_LINES - 1]
    rows = [HEAD, *(line.cells() for line in overview(data, shown))]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    more = len(keys) - len(shown)
    return [*lines, f"... and {format_count(more, 'case')} more in the report"] if more else lines
