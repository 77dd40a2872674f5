"""Tabulate multipliers that are not unique, and the time label of a multiplier."""

from __future__ import annotations

import functools

import numpy as np

from nsbench.report.claims import rounding_span
from nsbench.report.data import LABELS, Data
from nsbench.report.style import (
    format_number,
)
from nsbench.report.summary import (
    Order,
    Summary,
    estimate_order,
)
from nsbench.report.tables.cells import Cell, Row, Table
from nsbench.report.tables.order_table import order_cell


def selection_table(data: Data, summaries: dict[tuple, Summary]) -> Table:
    """Build the table of cases whose multipliers are not unique.

    It shows what converges (reaction, distance to the set of multipliers), and the plateau that a
    comparison with one multiplier of the set would show.
    """
    from nsbench.measure import fit_order

    rows = []
    for (case, solver), s in summaries.items():
        if (
            s.word != "ok"
            or s.runs.unique
            or not np.isfinite(s.runs.col["selection"][s.runs.good]).any()
        ):
            continue
        fit = functools.partial(fit_order, span=rounding_span(data, case, solver))
        naive = estimate_order(s.runs, "selection", {}, fit)
        distance = estimate_order(s.runs, "polyhedron", {}, fit)
        finest = int(np.nanargmin(np.where(s.runs.good, s.runs.col["h"], np.inf)))
        rows.append(
            Row(
                (
                    Cell(solver, kind="method"),
                    order_cell(s.force, s.runs.floor(s.force.metric)),
                    order_cell(distance, s.runs.floor(distance.metric)),
                    Cell(
                        format_number(float(s.runs.col["selection"][finest])),
                        "",
                        naive.sentence,
                        "number",
                    ),
                    _naive(naive),
                ),
                case,
                solver,
            )
        )
    note = (
        "The multipliers of these cases are not unique. What is unique is the reaction; a "
        "multiplier is right when its distance to the set of all that give the reaction goes to "
        "zero. WARNING, an example of how not to measure: the last column is what a comparison "
        "with one multiplier of that set (the least-norm one) would make of the same runs. A "
        "plateau there is the selection that the method makes, not an error of it."
    )
    return Table(
        "selection",
        (
            "method",
            "reaction",
            "distance to the set",
            "selection at the finest step",
            "a naive comparison would say",
        ),
        tuple(rows),
        note if rows else "",
    )


LABEL_COLUMNS = {
    "start": "lam_at_start",
    "midpoint": "lam_at_mid",
    "end": "lam_at_end",
    "mean": "lam_mean",
}


MIN_LABEL_RATIO = 3.0  # of the errors at two places: below it the place is irrelevant
ROUNDING = 1e-12  # an error below it counts as this one


def labels_table(data: Data, summaries: dict[tuple, Summary]) -> Table:
    """Build the table of the multiplier of single steps, compared at each place in the step.

    It shows the error that a wrong time label causes.
    """
    from nsbench.measure import fit_order

    rows = []
    for (case, solver), s in summaries.items():
        good = s.runs.good
        own = next((w for w in s.runs.col["lam_time"] if w in LABEL_COLUMNS), "")
        if s.word != "ok" or not own or s.runs.accuracy != "h" or not _labels_differ(s, good):
            continue
        fit = functools.partial(fit_order, span=rounding_span(data, case, solver))
        cells = [
            _label(s, k, estimate_order(s.runs, k, {}, fit), k == LABEL_COLUMNS[own])
            for k in LABELS
        ]
        rows.append(Row((Cell(solver, kind="method"), Cell(own), *cells), case, solver))
    note = (
        "Largest error of the multiplier of single steps, away from events, against the exact one "
        "at four places in the step, at the finest step, with its order. A method declares the "
        "place its multiplier belongs to (bold); at another one the same numbers show another "
        "order: that is the error of the comparison, not of the method. Only methods and cases "
        "are listed where the place matters: where the error at one is three times that at "
        "another."
    )
    return Table(
        "labels",
        ("method", "declared", "start of the step", "middle", "end", "mean over the step"),
        tuple(rows),
        note if rows else "",
    )


def _labels_differ(s: Summary, good) -> bool:
    """Do the errors at two places differ by more than MIN_LABEL_RATIO at the finest step?"""
    known = good & np.all([np.isfinite(s.runs.col[k]) for k in LABELS], axis=0)
    if not known.any():
        return False
    at = np.flatnonzero(known)[np.argmin(s.runs.col["h"][known])]
    errors = [max(s.runs.col[k][at], s.runs.floor(k), ROUNDING) for k in LABELS]
    return max(errors) > MIN_LABEL_RATIO * min(errors)


def _label(s: Summary, name: str, o: Order, own: bool) -> Cell:
    """The error at one place in the step, with its order; own: the declared place."""
    col = s.runs.col
    good = s.runs.good & np.isfinite(s.runs.col[name])
    if not good.any():
        return Cell("not known", kind="quiet")
    error = float(col[name][good][np.argmin(col["h"][good])])
    floor = s.runs.floor(name)
    text = f"< {format_number(floor)}" if error < floor else format_number(error)
    small = (
        f"order {o.order:.2f}" if o.kind == "fit" and o.verdict == "order" else o.verdict or o.text
    )
    return Cell(text, small, o.sentence, "flag" if own else "number")


def _naive(o: Order) -> Cell:
    """What a comparison with the least-norm multiplier would show."""
    if o.kind == "fit":
        text = (
            f"plateau at {format_number(o.plateau)}"
            if o.verdict == "plateau"
            else f"{o.verdict}, slope {o.order:.2f}"
        )
        return Cell(
            text,
            "false alarm" if o.verdict == "plateau" or abs(o.order) < 0.5 else "",
            o.sentence,
            "quiet",
        )
    return Cell(o.text, "", o.sentence, "quiet")
