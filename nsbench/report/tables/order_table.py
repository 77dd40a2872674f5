"""Tabulate orders, constants and best errors by case and method."""

from __future__ import annotations

import numpy as np

from nsbench.columns import ABSOLUTE, RELATIVE
from nsbench.report.style import (
    format_number,
)
from nsbench.report.summary import (
    OPEN,
    Order,
    Summary,
    format_best_error,
    format_error,
)
from nsbench.report.tables.cells import Cell, Row, Table

COLUMNS = (
    "method",
    "state order",
    "constant",
    "multiplier order",
    "best state error",
    "best multiplier error",
    "events",
    "violation order",
)


def orders_table(summaries: dict[tuple[str, str], Summary]) -> Table:
    """Build the table: case x method with orders, constants, best errors, events, violation.

    A refusal, a failure, or a run without anything to compare with takes the whole line.
    """
    rows = [_row(case, solver, s) for (case, solver), s in summaries.items()]
    return Table(
        "orders",
        COLUMNS,
        tuple(rows),
        "Order p with its 95 % interval in error = C h^p, over the fit window; h is the step "
        "taken, 1/k for a penalty. Where the multipliers are not unique, or nearly not, the "
        "reaction, which is known, stands in for the impulse. ▲ or ▼: above or below the order "
        f"the method claims. Errors are {ABSOLUTE}; bounds that are claimed are {RELATIVE}.",
    )


def _row(case: str, solver: str, s: Summary) -> Row:
    """One line: a sentence if no run gave a number or none can be compared, else the orders."""
    name = Cell(solver, kind="method")
    whole_line = len(COLUMNS) - 1
    if s.outcome:
        return Row((name, Cell(s.outcome, kind=s.word, span=whole_line)), case, solver, s.word)
    has_residual = np.isfinite(s.runs.col["residual"][s.runs.good]).any()
    if s.state.kind == s.force.kind == "none" and has_residual:
        sentence = Cell(_residuals(s), kind="quiet", title=s.state.sentence, span=whole_line)
        return Row((name, sentence), case, solver)
    force = order_cell(s.force, s.runs.floor(s.force.metric))
    if s.force.metric == "reaction":
        small = f"{force.small} · reaction".strip(" ·")
        force = Cell(force.text, small, f"{s.runs.why_reaction}. {force.title}", force.kind)
    cells = (
        name,
        order_cell(s.state, s.runs.floor(s.state.metric)),
        _constant(s.state),
        force,
        _best(s, s.state),
        _best(s, s.force),
        _events(s),
        order_cell(s.violation),
    )
    return Row(cells, case, solver)


def order_cell(o: Order, floor: float = 0.0) -> Cell:
    """Write an order, a bound, or the words that stand for them; floor: of the smallest error."""
    mark = {"above": "▲", "below": "▼"}.get(o.flag, "")
    if o.kind == "fit":
        lo, hi = o.interval
        digits = 3 if hi - lo < 0.02 else 2
        interval = f"{lo:.{digits}f} … {hi:.{digits}f}"
        small = interval if o.verdict == "order" else f"{interval} {o.verdict}"
        if o.verdict == "plateau":
            small = f"plateau at {format_number(o.plateau)}"
        kind = "flag" if o.flag else "bad" if o.verdict in ("diverges", "plateau") else "number"
        return Cell(f"{o.order:.{digits}f} {mark}".strip(), small, o.sentence, kind)
    if o.kind == "bound":
        return Cell(o.text, o.verdict, o.sentence, "flag" if o.flag else "number")
    if o.kind == "exact":
        if o.metric == "feasibility":
            return Cell("no violation", "beyond rounding", o.sentence, "quiet")
        return Cell("no order", "exact at grid times", o.sentence, "quiet")
    return Cell(
        o.text,
        f"best {format_error(o.best, floor)}" if o.best == o.best else "",
        o.sentence,
        "quiet",
    )


def _constant(o: Order) -> Cell:
    """The constant C of error = C h^p."""
    if o.kind == "fit":
        return Cell(
            format_number(o.constant),
            o.verdict if o.verdict in OPEN else "",
            kind="quiet" if o.verdict in OPEN else "number",
            title=f"error ≈ {format_number(o.constant)} h^{o.order:.2f}",
        )
    return Cell("none", kind="quiet")


def _residuals(s: Summary) -> str:
    """The residuals of finished runs that nothing can be compared with."""
    residual = s.runs.col["residual"][s.runs.good]
    gap = s.runs.col["feasibility"][s.runs.good]
    tail = (
        f", violation at most {format_number(float(np.nanmax(gap)))}"
        if np.isfinite(gap).any()
        else ""
    )
    largest = format_number(float(np.nanmax(residual)))
    return f"{s.state.text}; equation residual at most {largest}{tail}"


def _best(s: Summary, o: Order) -> Cell:
    """The smallest error that a run reached."""
    text = format_best_error(s, o)
    return Cell(text, kind="number" if text[0] in "<0123456789" else "quiet", title=_at(s, o))


def _at(s: Summary, o: Order) -> str:
    """The accuracy parameter of the smallest error."""
    if o.best != o.best:
        return o.sentence
    return f"at {s.runs.accuracy if s.runs.accuracy != 'k' else '1/k'} = {format_number(o.best_h)}"


def _events(s: Summary) -> Cell:
    """Located events, and the smallest error of their times."""
    col = s.runs.col
    good = s.runs.good
    located = col["events"][good & np.isfinite(col["events"])]
    if not located.size or not located.any():
        return Cell(
            "not located",
            kind="quiet",
            title="A method on a fixed grid does not look for event times.",
        )
    errors = col["event_time"][good & np.isfinite(col["event_time"])]
    best = format_error(float(errors.min(initial=np.inf)), s.runs.floor("event_time"))
    return Cell(
        f"{int(located[-1])}", f"times to {best}" if errors.size else "", kind="number"
    )
