"""Tables on what the figures rest on: references, bounds kept, multipliers that are not unique,
expectations."""

from __future__ import annotations

import functools
import math

import numpy as np

from nsbench.report.data import LABELS, Data
from nsbench.report.expectations import Finding, new_deviations, resolved_deviations
from nsbench.report.style import format_count, format_number, sanitise
from nsbench.report.summary import Summary, estimate_order
from nsbench.report.tables import Cell, Row, Table, order_cell

HOW = {
    "closed form": "a formula in the case's file, tested against its equation",
    "none": "no reference: residuals only",
}


def bounds_table(data: Data, summaries: dict[tuple, Summary]) -> Table:
    """Methods that claim a bound: state relative to max(1, |x|), impulse and event times at the
    tightest tolerance."""
    rows = []
    for (case, solver), s in summaries.items():
        if s.state.kind != "bound" and s.runs.accuracy != "tol":
            continue
        if s.outcome:
            rows.append(
                Row(
                    (Cell(case), Cell(solver, kind="method"), Cell(s.outcome, kind=s.word, span=6)),
                    solver=solver,
                    kind=s.word,
                )
            )
            continue
        at = int(np.nanargmin(np.where(s.runs.good, s.runs.col["h"], np.inf)))
        col = {k: float(v[at]) for k, v in s.runs.col.items() if v.dtype.kind == "f"}
        wrong = [
            f"{int(col[k])} {word}"
            for k, word in (("events_missed", "missed"), ("events_extra", "not in the reference"))
            if col[k] > 0
        ]
        told = _known(col, "event_time", "event_floor") if col["events"] > 0 or wrong else "none"
        events = Cell(told, ", ".join(wrong), kind="bad" if wrong else "number")
        force, push = (
            Cell(_known(col, name, f"{name}_floor"), kind="number")
            for name in ("impulse", "reaction")
        )
        rows.append(
            Row(
                (
                    Cell(case),
                    Cell(solver, kind="method"),
                    _bounded(s, col),
                    force,
                    push,
                    events,
                    Cell(
                        format_number(col["events"]) if col["events"] == col["events"] else "0",
                        kind="number",
                    ),
                    Cell(str(s.runs.col["reference"][at]) or "none", _bound(col["state_floor"])),
                ),
                solver=solver,
            )
        )
    return Table(
        "bounds",
        (
            "case",
            "method",
            "state / max(1, |x|)",
            "impulse",
            "reaction",
            "event times",
            "events",
            "reference, its bound",
        ),
        tuple(rows),
        "Largest errors over all samples at the tightest tolerance run. A figure after “<” is ten "
        "times the reference's own bound: the error lies below it.",
    )


def _bounded(s: Summary, col: dict) -> Cell:
    relative = (
        col["state_sup"] / max(1.0, col["state_scale"])
        if col["state_scale"] == col["state_scale"]
        else col["state_sup"]
    )
    floor = col["state_floor"] if col["state_floor"] == col["state_floor"] else 0.0
    text = f"< {format_number(floor)}" if col["state_sup"] < floor else _small(relative)
    return Cell(text, "", s.state.sentence, "flag" if s.state.flag else "number")


def _known(col: dict, name: str, floor: str) -> str:
    """An error, or ten times the bound of the reference where it lies below that."""
    least = col.get(floor, math.nan)
    return f"< {format_number(least)}" if col[name] < least else _small(col[name])


def _small(value: float) -> str:
    return format_number(value) if math.isfinite(value) else "not known"


def _bound(floor: float) -> str:
    return format_number(floor / 10) if math.isfinite(floor) and floor > 0 else ""


def references_table(data: Data) -> Table:
    """Every case: what its errors are measured against, the bound of it, and how it was made."""
    rows = []
    for case in data.case_keys:
        known = data.cases.get(case, {})
        told = known.get("certificate") if isinstance(known.get("certificate"), dict) else {}
        kind = sanitise(known.get("reference") or "none", 200)
        figures = [
            Cell(_small(_float(told.get(k))), kind="number")
            for k in ("state", "impulse", "reaction", "event")
        ]
        rows.append(
            Row(
                (
                    Cell(case, kind="method"),
                    Cell(kind),
                    *figures,
                    Cell(sanitise(told.get("how") or HOW.get(kind, "not told"), 400)),
                )
            )
        )
    return Table(
        "references",
        ("case", "reference", "state", "impulse", "reaction", "event times", "how it was made"),
        tuple(rows),
        "Bounds of the reference's own error (largest absolute value). No error below ten times "
        "its bound is shown as a number. Certified: integrated once more in 30 digits with its "
        "inequalities proved along every arc.",
    )


def _float(value) -> float:
    try:
        return math.nan if value is None else float(value)
    except (TypeError, ValueError):
        return math.nan


def selection_table(data: Data, summaries: dict[tuple, Summary]) -> Table:
    """Cases whose multipliers are not unique: what converges, and the plateau that a naive
    comparison would show."""
    from nsbench.measure import fit_order

    rows = []
    for (case, solver), s in summaries.items():
        if (
            s.word != "ok"
            or s.runs.unique
            or not np.isfinite(s.runs.col["selection"][s.runs.good]).any()
        ):
            continue
        span = _float(data.cases.get(case, {}).get("T"))
        fit = functools.partial(fit_order, span=span if span > 0 else 1.0)
        naive = estimate_order(s.runs, "selection", {}, fit)
        inside = estimate_order(s.runs, "polyhedron", {}, fit)
        finest = int(np.nanargmin(np.where(s.runs.good, s.runs.col["h"], np.inf)))
        rows.append(
            Row(
                (
                    Cell(solver, kind="method"),
                    order_cell(s.force),
                    order_cell(inside),
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


OWN = {"start": "lam_at_start", "midpoint": "lam_at_mid", "end": "lam_at_end", "mean": "lam_mean"}


def labels_table(data: Data, summaries: dict[tuple, Summary]) -> Table:
    """The multiplier of single steps at each place in the step: what a wrong time label costs."""
    from nsbench.measure import fit_order

    rows = []
    for (case, solver), s in summaries.items():
        good = s.runs.good
        own = next((w for w in s.runs.col["lam_time"] if w in OWN), "")
        if s.word != "ok" or not own or s.runs.accuracy != "h" or not _labels_differ(s, good):
            continue
        span = _float(data.cases.get(case, {}).get("T"))
        fit = functools.partial(fit_order, span=span if span > 0 else 1.0)
        cells = [_label(s, k, estimate_order(s.runs, k, {}, fit), k == OWN[own]) for k in LABELS]
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
    """Is the error at one place in the step more than three times that at another, at the finest
    step?"""
    known = good & np.all([np.isfinite(s.runs.col[k]) for k in LABELS], axis=0)
    if not known.any():
        return False
    at = np.flatnonzero(known)[np.argmin(s.runs.col["h"][known])]
    errors = [max(s.runs.col[k][at], s.runs.floor(k), 1e-12) for k in LABELS]
    return max(errors) > 3 * min(errors)


def _label(s: Summary, name: str, o, own: bool) -> Cell:
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


def _naive(o) -> Cell:
    if o.kind == "fit":
        text = (
            f"plateau at {format_number(o.plateau)}"
            if o.verdict == "plateau"
            else f"{o.verdict}, slope {o.order:.2f}"
        )
        return Cell(
            text,
            "false" if o.verdict == "plateau" or abs(o.order) < 0.5 else "",
            o.sentence,
            "quiet",
        )
    return Cell(o.text, "", o.sentence, "quiet")


def expected_table(found: list[Finding], known: dict | None = None) -> Table:
    """Every deviation from what is expected, in either direction: new ones first, then those gone,
    then known ones."""
    lost = resolved_deviations(found, known)
    new = new_deviations(found, known)
    old = [f for f in found if f.known]
    rows = [_line("new", f, f.why, "flag") for f in new]
    rows += [
        Row(
            (
                Cell("no longer seen", kind="bad"),
                Cell(f.solver, kind="method"),
                Cell(f.case),
                Cell(f.metric),
                Cell(f.expected),
                Cell(f.observed),
                Cell(f"expected to be “{was}”: {reason}"),
            ),
            solver=f.solver,
        )
        for f, was, reason in lost
    ]
    rows += [_line("known", f, f.known, "quiet") for f in old]
    kept = sum(f.outcome == "kept" for f in found)
    open_ = sum(f.outcome == "open" and not f.known for f in found)
    note = (
        f"{format_count(len(found), 'expectation')}: {kept} kept, {open_} without a verdict, "
        f"{len(old)} known deviations, {len(new)} new ones, {len(lost)} known ones no longer seen "
        "as they were."
    )
    return Table(
        "expected",
        ("deviation", "method", "case", "metric", "expected", "observed", "why"),
        tuple(rows),
        note,
    )


def _line(word: str, f: Finding, why: str, kind: str) -> Row:
    return Row(
        (
            Cell(word, f.outcome, kind=kind),
            Cell(f.solver, kind="method"),
            Cell(f.case),
            Cell(f.metric),
            Cell(f.expected),
            Cell(f.observed),
            Cell(why),
        ),
        solver=f.solver,
    )
