"""Compare what each method should show on each case with what it shows; list known deviations.

The expectation comes from the claims of the method and from the classes of the case. Known
deviations are in deviations.csv beside this file, with their reason. One that is no longer observed
is reported like a new one: either way the table and the methods disagree.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

from nsbench.report.claims import find_expectation
from nsbench.report.data import Data
from nsbench.report.style import format_number
from nsbench.report.summary import CLAIM_TOLERANCE, OPEN, Order, Summary

TABLE = Path(__file__).with_name("deviations.csv")
COLUMNS = ("case", "solver", "metric", "observed", "why")
METRICS = ("state", "impulse")
Wanted = float | str | tuple[str, float]  # an order, a word, or ("bound", largest error)


@dataclass(frozen=True)
class Finding:
    """The outcome of one expectation: one metric of one method on one case.

    expected: as declared. observed: in a few words. outcome: "kept", "open" (no verdict, where one
    was expected), else what was observed instead: "above", "below", "exact", "plateau", "diverges",
    "order", "passes", or a status. why: reason of the expectation. known: reason of a known
    deviation, "" if it is new.
    """

    case: str
    solver: str
    metric: str
    expected: str
    observed: str
    outcome: str
    why: str
    known: str = ""


def read_deviations(path: Path = TABLE) -> dict[tuple[str, str, str], tuple[str, str]]:
    """Read the table of known deviations: (case, solver, metric) -> (observed, why).

    Raises ValueError, which names the line, for one that is not complete or is repeated.
    """
    out: dict = {}
    with open(path, newline="", encoding="utf-8") as file:
        for k, row in enumerate(csv.DictReader(file), start=2):
            if None in row or not all(row.get(c) for c in COLUMNS) or row["metric"] not in METRICS:
                raise ValueError(
                    f"{path.name}, line {k}: {', '.join(COLUMNS)} are needed, metric one of "
                    f"{METRICS}"
                )
            key = row["case"], row["solver"], row["metric"]
            if key in out:
                raise ValueError(f"{path.name}, line {k}: {key} stands there twice")
            out[key] = row["observed"], row["why"]
    return out


def judge_expectations(
    data: Data, summaries: dict[tuple, Summary], known: dict | None = None
) -> list[Finding]:
    """Judge every case x method x metric of which something is expected.

    A refusal is no deviation from a claim. known: deviations by (case, solver, metric), by default
    those of deviations.csv.
    """
    known = read_deviations() if known is None else known
    out = []
    for (case, solver), s in summaries.items():
        expected = find_expectation(data.cases.get(case, {}), data.solvers.get(solver, {}))
        for metric, order in zip(METRICS, (s.state, s.force), strict=True):
            wanted = expected[metric]
            if wanted is None or (s.word == "refused" and wanted != "refused"):
                continue
            outcome = judge(wanted, s, order)
            observed, reason = known.get((case, solver, metric), ("", ""))
            out.append(
                Finding(
                    case,
                    solver,
                    metric,
                    describe_expected(wanted),
                    describe_observed(s, order),
                    outcome,
                    expected["why"],
                    reason if observed == outcome else "",
                )
            )
    return out


def describe_expected(want: Wanted) -> str:
    """Format an expectation: ``at most 1e-10, relative``, ``order 1``, ``plateau``."""
    if isinstance(want, tuple):
        return f"at most {format_number(want[1])}, relative"
    return f"order {want:g}" if isinstance(want, (int, float)) else str(want)


def describe_observed(s: Summary, o: Order) -> str:
    """Format what is observed in a few words: the order, the verdict, or why there is none."""
    if s.outcome:
        return s.outcome
    return (
        f"order {o.text}"
        if o.kind == "fit" and o.verdict == "order"
        else f"{o.verdict} ({o.text})"
        if o.kind == "fit"
        else o.text
    )


def judge(want: Wanted, s: Summary, o: Order) -> str:
    """Decide the outcome of one expectation, see `Finding`."""
    if want == "open":
        return "kept" if not s.outcome else _status(s)
    if s.outcome:
        return "kept" if want == _status(s) else _status(s)
    if isinstance(want, str) and want not in ("exact", "plateau", "diverges"):
        return "passes"  # a failure was expected, and runs gave numbers
    if o.kind == "bound":
        return "below" if o.flag else "open" if o.verdict == "below reference" else "kept"
    if o.kind in ("level", "none"):
        return "kept" if o.verdict == "below reference" or o.text == "below reference" else "open"
    if o.kind == "exact":
        return "kept" if want == "exact" else "exact"
    if o.verdict in OPEN:
        return "open"
    if o.verdict in ("plateau", "diverges"):
        return "kept" if want == o.verdict else o.verdict
    if isinstance(want, str):
        return "below" if want == "exact" else "order"
    lo, hi = o.interval
    if abs(o.order - want) <= CLAIM_TOLERANCE or lo <= want <= hi:
        return "kept"
    return "above" if o.order > want else "below"


def _status(s: Summary) -> str:
    return s.statuses.most_common(1)[0][0]


def resolved_deviations(
    found: list[Finding], known: dict | None = None
) -> list[tuple[Finding, str, str]]:
    """List known deviations of this study's pairs that are no longer observed.

    Returns triples (finding, what was observed then, its reason).
    """
    known = read_deviations() if known is None else known
    out = []
    for f in found:
        was = known.get((f.case, f.solver, f.metric))
        if was is not None and was[0] != f.outcome:
            out.append((f, *was))
    return out


def new_deviations(found: list[Finding], known: dict | None = None) -> list[Finding]:
    """List the findings that deviate and that the table of known deviations does not hold."""
    known = read_deviations() if known is None else known
    return [
        f
        for f in found
        if f.outcome not in ("kept", "open") and (f.case, f.solver, f.metric) not in known
    ]
