"""Table for the terminal at the end of `nsbench run`: per case the best method, its error and cost.

Best at the state error TARGET is what nsbench.report.answers.best_method says, as in the report;
where no error is known, or none is small enough, the line says so.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from nsbench.measure.compared_multiplier import NEARLY
from nsbench.report.answers.best_method import TARGET, best_at
from nsbench.report.answers.multipliers import NOT_KNOWN, tell_least_error, tell_order
from nsbench.report.claims import claims_on, rounding_span
from nsbench.report.cost import format_setting
from nsbench.report.data import Data, Runs
from nsbench.report.style import format_count, format_timing
from nsbench.report.summary import Order, Summary, estimate_order, summarise
from nsbench.trajectory import NO_FAILURE

MAX_LINES = 10
COUNTS = ("refused", "unverified", "failed")
HEAD = ("case", f"best at {TARGET:g}", "seconds", "order", "multipliers", *COUNTS)
NOT_REACHED = "not reached"


@dataclass(frozen=True)
class Line:
    """One case: its best method with setting, seconds, order and error of the multipliers.

    seconds: NaN where no method is best; loop: that in which they were taken. refused, unverified,
    failed: numbers of methods that refuse the case, of runs whose error is not certain, and of runs
    that ended with a failure.
    why_reaction: why the multipliers are judged by the reaction, "" where they are not.
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
    why_reaction: str = ""
    loop: str = ""

    def cells(self) -> tuple[str, ...]:
        """Return the cells of the table."""
        best = f"{self.best} ({self.setting})" if self.setting else self.best
        seconds = format_timing(self.seconds, self.loop) if self.seconds > 0 else "-"
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
    why = next((r.why_reaction for r in runs if r.why_reaction), "")
    best = best_at(data, case, TARGET, functools.partial(_summaries, data, runs))
    if best.cost is None:
        measured = any(np.isfinite(r.col["state_sup"][r.good]).any() for r in runs)
        word = NOT_REACHED if measured else NOT_KNOWN
        if refused == len(runs):
            word = "refused"
        return Line(case, word, "", math.nan, "-", "-", *counts, why)
    chosen = next(r for r in runs if r.solver == best.cost.solver)
    force = "reaction" if why else "impulse"
    setting = format_setting(best.cost)
    multipliers = tell_least_error(chosen, force)
    if best.cost.is_extrapolated:
        setting += ", extrapolated"
        multipliers = tell_order(_order(data, chosen, force))
    order = _order(data, chosen, "state_sup").text
    cost = best.cost
    return Line(
        case, cost.solver, setting, cost.seconds, order, multipliers, *counts, why, cost.loop
    )


def _summaries(data: Data, runs: list[Runs], seconds: float) -> Iterator[Summary]:
    """Summarise the methods of a case that may take fewer seconds beyond their finest run."""
    some = {(r.case, r.solver): r for r in runs if _finest_seconds(r) < seconds}
    yield from summarise(replace(data, runs=some)).values()


def _finest_seconds(runs: Runs) -> float:
    """Return the seconds of the finest run that ended well, inf where none has an error."""
    good = runs.good & np.isfinite(runs.col["state_sup"]) & (runs.col["h"] > 0.0)
    return float(runs.col["seconds"][good][-1]) if good.any() else math.inf


def _order(data: Data, runs: Runs, metric: str) -> Order:
    """Return the order of an error in the words of the report."""
    from nsbench.measure import fit_order

    fit = functools.partial(fit_order, span=rounding_span(data, runs.case, runs.solver))
    return estimate_order(runs, metric, claims_on(data, runs.case, runs.solver), fit)


def format_overview(data: Data) -> list[str]:
    """Return the table as lines of aligned cells: at most MAX_LINES cases, the rest as a count."""
    keys = data.case_keys
    shown = keys if len(keys) <= MAX_LINES else keys[: MAX_LINES - 1]
    found = overview(data, shown)
    rows = [HEAD, *(line.cells() for line in found)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    lines += [f"{o.case}: {o.why_reaction}" for o in found if o.why_reaction.startswith(NEARLY)]
    more = len(keys) - len(shown)
    return [*lines, f"... and {format_count(more, 'case')} more in the report"] if more else lines
