"""Tabulate the basis of the numbers: expectations, error bounds, references."""

from __future__ import annotations

import math
import re

import numpy as np

from nsbench.columns import ABSOLUTE, RELATIVE
from nsbench.measure.compared_multiplier import NOT_UNIQUE
from nsbench.report.answers.multipliers import explain_reactions
from nsbench.report.data import Data
from nsbench.report.expectations import Finding, new_deviations, resolved_deviations
from nsbench.report.style import (
    format_count,
    format_number,
    sanitise,
)
from nsbench.report.summary import (
    Summary,
)
from nsbench.report.tables.cells import Cell, Row, Table

ORIGIN_OF_REFERENCE = {
    "closed form": "a formula in the case's file, tested against its equation",
    "none": "no reference: residuals only",
}
# how far to rely on a reference, by its kind
RELIANCE = {
    "certified": "A certified bound: the true solution is proven to lie within it{exception}.",
    "stored": "Two integrators agree to half the bound, which is no proof{witness}.",
    "confirmed": "A closed form within a certified bound{exception}.",
    "closed form": "A closed form, whose bound counts roundings and is not proven.",
    "none": "Nothing to rely on: no error is known.",
}
CERTIFIED = "certified bound"
PROVEN = (
    " Certified: integrated once more in 200 bits, 60 digits, of which 30 are kept, with its "
    "inequalities proved along every arc."
)
WITNESS = "; a witness, another method, comes closer with smaller steps"
CLOSER = re.compile(r"; \S+ comes from \S+ to \S+ when")  # what a witness alone has beside it
UNPROVEN = ", but for what is called not proven beside it"


def bounds_table(data: Data, summaries: dict[tuple[str, str], Summary]) -> Table:
    """Build the table of methods that claim a bound: their errors at the tightest tolerance."""
    rows = [
        _bounds_row(case, solver, s)
        for (case, solver), s in summaries.items()
        if s.state.kind == "bound" or s.runs.accuracy == "tol"
    ]
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
        f"Largest errors over all samples at the tightest tolerance run: of the state {RELATIVE}, "
        f"as the bound is claimed, all others {ABSOLUTE}. A figure after “<” is ten "
        "times the reference's own bound: the error lies below it.",
    )


def _bounds_row(case: str, solver: str, s: Summary) -> Row:
    """One line: relative state error, impulse, reaction and event times, or why there is none."""
    name = Cell(solver, kind="method")
    if s.outcome:
        outcome = Cell(s.outcome, kind=s.word, span=6)
        return Row((Cell(case), name, outcome), solver=solver, kind=s.word)
    at = int(np.nanargmin(np.where(s.runs.good, s.runs.col["h"], np.inf)))
    col = {k: float(v[at]) for k, v in s.runs.col.items() if v.dtype.kind == "f"}
    number_of_events = str(int(col["events"])) if col["events"] == col["events"] else "0"
    cells = (
        Cell(case),
        name,
        _bounded(s, col),
        Cell(_known(col, "impulse", "impulse_floor"), kind="number"),
        Cell(_known(col, "reaction", "reaction_floor"), kind="number"),
        _event_times(col),
        Cell(number_of_events, kind="number"),
        Cell(str(s.runs.col["reference"][at]) or "none", _bound(col["state_floor"])),
    )
    return Row(cells, solver=solver)


def _event_times(col: dict) -> Cell:
    """The error of event times; events that were missed or are not in the reference."""
    wrong = [
        f"{int(col[k])} {word}"
        for k, word in (("events_missed", "missed"), ("events_extra", "not in the reference"))
        if col[k] > 0
    ]
    error = _known(col, "event_time", "event_floor") if col["events"] > 0 or wrong else "none"
    return Cell(error, ", ".join(wrong), kind="bad" if wrong else "number")


def _bounded(s: Summary, col: dict) -> Cell:
    """The state error relative to max(1, |x|), or the floor of the reference above it."""
    floor = col["state_floor"] if col["state_floor"] == col["state_floor"] else 0.0
    below = col["state_sup"] < floor
    relative = s.runs.relative("state_sup", floor if below else col["state_sup"])
    text = f"< {format_number(relative)}" if below else _format_error(relative)
    return Cell(text, "", s.state.sentence, "flag" if s.state.flag else "number")


def _known(col: dict, name: str, floor: str) -> str:
    """An error, or ten times the bound of the reference where it lies below that."""
    reference_floor = col.get(floor, math.nan)
    return (
        f"< {format_number(reference_floor)}"
        if col[name] < reference_floor
        else _format_error(col[name])
    )


def _format_error(value: float) -> str:
    """An error, or words where it is not known."""
    return format_number(value) if math.isfinite(value) else "not known"


def _bound(floor: float) -> str:
    """The bound of a reference's own error, a tenth of the floor."""
    return format_number(floor / 10) if math.isfinite(floor) and floor > 0 else ""


def references_table(data: Data, summaries: dict[tuple, Summary]) -> Table:
    """Build the table of references: what the errors of each case are measured against.

    It gives the bounds of the reference's own error, and how the reference was computed. Impulses
    that are not unique, where the reaction is compared instead, have no error.
    """
    rows = []
    reasons = explain_reactions(summaries)
    is_certified = False
    for case in data.case_keys:
        stored = data.cases.get(case, {})
        certificate = (
            stored.get("certificate") if isinstance(stored.get("certificate"), dict) else {}
        )
        kind = sanitise(stored.get("reference") or "none", 200)
        how = sanitise(certificate.get("how") or ORIGIN_OF_REFERENCE.get(kind, "not told"), 400)
        reliance = describe_reliance(kind, how)
        is_certified |= CERTIFIED in reliance
        figures = [
            Cell("not unique", kind="quiet")
            if k == "impulse" and reasons.get(case) == NOT_UNIQUE
            else Cell(
                _format_error(to_float(certificate.get(k))),
                reasons.get(case, "") if k == "impulse" else "",
                kind="number",
            )
            for k in ("state", "impulse", "reaction", "event")
        ]
        rows.append(
            Row(
                (
                    Cell(case, kind="method"),
                    Cell(kind),
                    *figures,
                    Cell(reliance),
                    Cell(how),
                ),
                anchor=case,
            )
        )
    return Table(
        "references",
        (
            "case",
            "reference",
            "state",
            "impulse",
            "reaction",
            "event times",
            "how far to rely on it",
            "how it was made",
        ),
        tuple(rows),
        "Bounds of the reference's own error (largest absolute value). No error below ten times "
        f"its bound is shown as a number.{PROVEN if is_certified else ''}",
    )


def describe_reference(data: Data, case: str, is_unique: bool) -> str:
    """Say in one sentence what the errors of a case are measured against, and its own error.

    is_unique: the multipliers are; else impulses have no error.

    ``Reference: certified; its own error is at most 2e-16 in the state, 1e-15 in the reaction.``
    """
    stored = data.cases.get(case, {})
    kind = sanitise(stored.get("reference") or "none", 200)
    certificate = stored.get("certificate")
    bounds = certificate if isinstance(certificate, dict) else {}
    words = {"state": "the state", "reaction": "the reaction"}
    words |= {"impulse": "an impulse"} if is_unique else {}
    known = [(to_float(bounds.get(k)), word) for k, word in words.items()]
    said = [f"{format_number(v)} in {word}" for v, word in known if math.isfinite(v)]
    own = "no bound of its error is known"
    if said:
        own = f"its own error is at most {', '.join(said)}"
    return "" if kind == "none" else f"Reference: {kind}; {own}."


def describe_reliance(kind: str, how: str) -> str:
    """Say in one sentence how far a reference can be relied on: proof, agreement, or a formula.

    kind: of the reference. how: the sentence that tells how it was made.
    """
    if kind == "closed form" and "a certificate differs by" in how:
        kind = "confirmed"
    if kind not in RELIANCE:
        return RELIANCE["none"] if kind.startswith("unusable") else "Its origin is not told."
    return RELIANCE[kind].format(
        exception=UNPROVEN if "not proven" in how else "",
        witness=WITNESS if CLOSER.search(how) else "",
    )


def to_float(value: object) -> float:
    """Convert a stored value to a float; NaN if it is none."""
    try:
        return math.nan if value is None else float(value)
    except (TypeError, ValueError):
        return math.nan


def expected_table(found: list[Finding], known: dict | None = None) -> Table:
    """Build the table of deviations from what is expected, in either direction.

    New ones come first, then known ones that are no longer observed, then known ones.
    """
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
    """One deviation."""
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
