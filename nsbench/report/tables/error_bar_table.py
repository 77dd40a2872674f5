"""Tabulate error bars, which are computed from a run alone, beside the errors of the same runs."""

from __future__ import annotations

import numpy as np

from nsbench.report.charts.bar_texts import KINDS, QUANTITIES, measurable
from nsbench.report.data import Runs
from nsbench.report.style import format_count, format_number
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
        "Error bars are computed from a run alone, in the 2-norm and largest over the samples: "
        "proven bounds for convex constraints with flat faces, estimates, which nothing proves, "
        "elsewhere. The effectivity is error bar over error, over all runs whose error can be "
        "measured."
    )
    note = " ".join(filter(None, (note, _bounds_held(summaries), _too_small(summaries))))
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


def _bounds_held(summaries: dict[tuple, Summary]) -> str:
    """Count the proven bounds, and name those below the error, each of which is a fault."""
    totals = {}
    low = []
    for quantity in QUANTITIES.values():
        totals[quantity], found = _below(summaries, "bound", quantity)
        low += found
    total = sum(totals.values())
    if not total:
        return ""
    parts = " and ".join(f"{n} of the {quantity}" for quantity, n in totals.items() if n)
    counted = f"{format_count(total, 'proven bound')} ({parts})"
    if not low:
        return f"Of {counted} none is below the error."
    return f"Of {counted} {_are(low)} below the error, which is a fault: {_name(low, 6)}."


def _too_small(summaries: dict[tuple, Summary]) -> str:
    """Count the estimates of the state, and name those below the error, worst first."""
    total, low = _below(summaries, "estimate", "state")
    if not total:
        return ""
    counted = f"Estimates are no bounds: of {format_count(total, 'estimate')} of the state"
    if not low:
        return f"{counted}, none is below the error."
    return f"{counted}, {_are(low)} below the error: {_name(low, 2)}."


def _below(summaries: dict[tuple, Summary], kind: str, quantity: str) -> tuple[int, list]:
    """Count the error bars of a kind; return that and effectivity and name of each below 1."""
    total = 0
    low = []
    for (case, solver), s in summaries.items():
        ratio = _effectivities(s.runs, kind, quantity)
        total += len(ratio)
        low += [(float(r), f"{solver} on {case}") for r in ratio[ratio < 1.0]]
    return total, low


def _are(low: list) -> str:
    """Write "1 is" or "3 are"."""
    return f"{len(low)} {'is' if len(low) == 1 else 'are'}"


def _name(low: list[tuple[float, str]], digits: int) -> str:
    """Name methods and cases with their least effectivity to so many digits, worst first."""
    least = {}
    for ratio, name in sorted(low):
        least.setdefault(name, ratio)
    names = [f"{name} (down to {format_number(r, digits)} times)" for name, r in least.items()]
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return f"{', '.join(names[:MOST_NAMED])}{more}"


def _range(runs: Runs, kind: str, quantity: str) -> Cell:
    """The range of the effectivities; one below 1 is marked."""
    ratio = _effectivities(runs, kind, quantity)
    if not len(ratio):
        return Cell("no error to compare with", kind="quiet")
    low = float(ratio.min())
    digits = 3 if kind == "bound" else 2  # whether a bound is below 1 must be seen
    text = " to ".join(format_number(v, digits) for v in (low, float(ratio.max())))
    return Cell(text, kind="bad" if low < 1.0 else "number")
