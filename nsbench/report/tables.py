"""The tables of the report as plain data; `page` writes them as HTML and `text` as Markdown."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from nsbench.columns import describe
from nsbench.report import cost as speed
from nsbench.report.data import Data
from nsbench.report.style import (
    LEADING_METHOD,
    TIMES,
    format_count,
    format_factor,
    format_number,
    format_power,
    format_seconds,
    join_names,
    method_of,
    sanitise,
)
from nsbench.report.summary import (
    Order,
    Summary,
    count_finished,
    format_best_error,
    format_statuses,
)


@dataclass(frozen=True)
class Cell:
    """text with a second, quieter line `small`; title: the sentence behind it; kind: a word that
    sets the tone (number, flag, bad, refused, failed, quiet, best, method); span: columns taken."""

    text: str
    small: str = ""
    title: str = ""
    kind: str = ""
    span: int = 1


@dataclass(frozen=True)
class Row:
    """Cells of one line; group: the case it belongs to, shown once as a heading; solver: for
    filters."""

    cells: tuple[Cell, ...]
    group: str = ""
    solver: str = ""
    kind: str = ""


@dataclass(frozen=True)
class Table:
    """`note` stands below; `key` is an id within the page."""

    key: str
    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    note: str = ""


def orders_table(summaries: dict[tuple, Summary]) -> Table:
    """Case x method: orders, constants, best errors, events, violation; a refusal or failure takes
    the whole line."""
    columns = (
        "method",
        "state order",
        "constant",
        "multiplier order",
        "best state error",
        "best multiplier error",
        "events",
        "violation order",
    )
    rows = []
    for (case, solver), s in summaries.items():
        name = Cell(solver, kind="method")
        if s.outcome:
            rows.append(
                Row(
                    (name, Cell(s.outcome, kind=s.word, span=len(columns) - 1)),
                    case,
                    solver,
                    s.word,
                )
            )
            continue
        if (
            s.state.kind == s.force.kind == "none"
            and np.isfinite(s.runs.col["residual"][s.runs.good]).any()
        ):
            rows.append(
                Row(
                    (
                        name,
                        Cell(
                            _blind(s), kind="quiet", title=s.state.sentence, span=len(columns) - 1
                        ),
                    ),
                    case,
                    solver,
                )
            )
            continue
        force = order_cell(s.force)
        if s.force.metric == "reaction":
            force = Cell(
                force.text, f"{force.small} · reaction".strip(" ·"), force.title, force.kind
            )
        rows.append(
            Row(
                (
                    name,
                    order_cell(s.state),
                    _constant(s.state),
                    force,
                    _best(s, s.state),
                    _best(s, s.force),
                    _events(s),
                    order_cell(s.violation),
                ),
                case,
                solver,
            )
        )
    return Table(
        "orders",
        columns,
        tuple(rows),
        "Order p with its 95 % interval in error = C h^p, over the fit window; h is the step "
        "taken, 1/k for a penalty. Where the multipliers are not unique the reaction, which is, "
        "stands in for the impulse. ▲ or ▼: above or below the order the method claims.",
    )


def order_cell(o: Order) -> Cell:
    """An order, a bound or the words that stand for them."""
    mark = {"above": "▲", "below": "▼"}.get(o.flag, "")
    if o.kind == "fit":
        lo, hi = o.interval
        digits = 3 if hi - lo < 0.02 else 2
        interval = f"{lo:.{digits}f} … {hi:.{digits}f}"
        small = interval if o.verdict == "order" else f"{interval} {o.verdict}"
        if o.verdict == "plateau":
            small = f"plateau at {format_number(o.plateau)}"
        kind = "flag" if o.flag else "bad" if o.verdict in ("diverges", "plateau") else "number"
        return Cell(f"{o.order:.2f} {mark}".strip(), small, o.sentence, kind)
    if o.kind == "bound":
        return Cell(o.text, o.verdict, o.sentence, "flag" if o.flag else "number")
    if o.kind == "exact":
        if o.metric == "feasibility":
            return Cell("no violation", "beyond rounding", o.sentence, "quiet")
        return Cell("no order", "exact at grid times", o.sentence, "quiet")
    return Cell(
        o.text, f"best {format_number(o.best)}" if o.best == o.best else "", o.sentence, "quiet"
    )


def _constant(o: Order) -> Cell:
    if o.kind == "fit":
        return Cell(
            format_number(o.constant),
            kind="number",
            title=f"error ≈ {format_number(o.constant)} h^{o.order:.2f}",
        )
    return Cell("none", kind="quiet", title="A constant belongs to an order.")


def _blind(s: Summary) -> str:
    """What can still be said of finished runs that nothing can be compared with."""
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
    text = format_best_error(s, o)
    return Cell(text, kind="number" if text[0] in "<0123456789" else "quiet", title=_at(s, o))


def _at(s: Summary, o: Order) -> str:
    if o.best != o.best:
        return o.sentence
    return f"at {s.runs.accuracy if s.runs.accuracy != 'k' else '1/k'} = {format_number(o.best_h)}"


def _events(s: Summary) -> Cell:
    col = s.runs.col
    good = s.runs.good
    located = col["events"][good & np.isfinite(col["events"])]
    if not located.size or not located.any():
        return Cell(
            "not located",
            kind="quiet",
            title="A method on a fixed grid does not look for event times.",
        )
    wrong = col["event_time"][good & np.isfinite(col["event_time"])]
    return Cell(
        f"{int(located[-1])}",
        f"times to {format_number(float(wrong.min()))}" if wrong.size else "",
        kind="number",
    )


def choice_table(data: Data) -> Table:
    """Case x error: the cheapest method, by seconds among compiled loops, by counted work where
    there is none."""
    rows = []
    if not any(np.isfinite(r.col["state_sup"][r.good]).any() for r in data.runs.values()):
        return Table("choice", (), ())
    for case in data.case_keys:
        cells = [Cell(case, kind="method")]
        for target in speed.TARGETS:
            found = speed.rank_costs(data, case, target)
            blind = not any(
                np.isfinite(r.col["state_sup"][r.good]).any() for r in data.of_case(case)
            )
            cells.append(Cell("no error known", kind="quiet") if blind else _choice(found, target))
        rows.append(Row(tuple(cells)))
    return Table(
        "choice",
        ("case", *(f"error {format_power(t)}" for t in speed.TARGETS)),
        tuple(rows),
        "The cheapest method whose state error stays below the figure at all smaller steps, with "
        "the accuracy it needs. Seconds are compared between compiled loops; “host loop” marks a "
        "method that alone reaches the error, or whose seconds measure the interpreter.",
    )


def _choice(found: list[speed.Cost], target: float) -> Cell:
    if not found:
        return Cell(
            "not reached", kind="quiet", title=f"No run stayed below {format_power(target)}."
        )
    first = found[0]
    bound = "at most " if first.at_most else ""
    small = f"{bound}{format_seconds(first.seconds)}, {speed.format_setting(first)}"
    others = ", ".join(f"{c.solver} {format_seconds(c.seconds)}" for c in found[1:])
    if first.loop != "compiled":
        small += f", {first.loop or 'unmarked'} loop"
    return Cell(
        first.solver,
        small,
        f"Also reached by: {others}." if others else "No other method reached it.",
        "best",
    )


def speed_table(data: Data) -> Table:
    """Case x method: seconds at equal error and the factor over PBD."""
    rows = []
    for case in data.case_keys:
        by_target = {t: speed.rank_costs(data, case, t) for t in speed.TARGETS}
        led = [r for r in data.of_case(case) if r.good.any()]
        for runs in data.of_case(case):
            mine = {
                t: next((c for c in found if c.solver == runs.solver), None)
                for t, found in by_target.items()
            }
            if not any(mine.values()):
                continue
            cells = [Cell(runs.solver, f"{runs.loop or 'unmarked'} loop", kind="method")]
            absent = (
                f"{LEADING_METHOD} does not reach it"
                if any(method_of(r.solver) == LEADING_METHOD for r in led)
                else f"no {LEADING_METHOD} here"
            )
            cells += [
                _speed(mine[t], speed.select_baseline(by_target[t]), absent) for t in speed.TARGETS
            ]
            rows.append(Row(tuple(cells), case, runs.solver))
    return Table(
        "speed",
        ("method", *(f"error {format_power(t)}" for t in speed.TARGETS)),
        tuple(rows),
        "Seconds to a state error, interpolated on the work-precision curve, and their factor "
        "over PBD. ≤: the coarsest run tried was already better, so that no factor can be given; "
        "“work” is the factor in drift calls + projections + inner iterations, for loops of "
        "different kinds.",
    )


def _speed(cost: speed.Cost | None, base: speed.Cost | None, absent: str) -> Cell:
    if cost is None:
        return Cell("not reached", kind="quiet")
    text = ("≤ " if cost.at_most else "") + format_seconds(cost.seconds)
    if base is None:
        return Cell(text, absent, kind="number")
    if cost.solver == base.solver:
        return Cell(text, f"{TIMES} 1 (the measure)", kind="number")
    if cost.at_most or base.at_most:
        return Cell(
            text, "bounds only", "A coarsest run was already better than this error.", "number"
        )
    ratio = speed.ratio_of_seconds(cost, base)
    work = speed.ratio_of_work(cost, base)
    small = (
        f"{TIMES} {format_factor(ratio)}"
        if ratio
        else f"work {TIMES} {format_factor(work)}"
        if work
        else "not comparable"
    )
    spread = (
        f"quartiles {format_seconds(cost.low)} and {format_seconds(cost.high)}"
        if np.isfinite(cost.low + cost.high)
        else ""
    )
    return Cell(
        text,
        small,
        spread if ratio else f"Not compared in seconds: {speed.why_not_comparable(cost, base)}.",
        "number",
    )


def failures_table(data: Data) -> Table:
    """Runs that gave no number, grouped by status, method and sentence, the numbers in it aside."""
    groups: dict = {}
    for (case, solver), runs in data.runs.items():
        for status, why in zip(runs.col["status"], runs.col["why"], strict=True):
            if status in ("ok", "below_reference"):
                continue
            alike = re.sub(r"[-+]?[\d.]+(e[-+]?\d+)?", "#", why)
            key = (status == "refused", status or "without status", solver, alike)
            entry = groups.setdefault(key, {"runs": 0, "why": why, "cases": {}})
            entry["runs"] += 1
            entry["cases"][case] = None
    rows = []
    for (refused, status, solver, _), entry in sorted(
        groups.items(), key=lambda g: (g[0][:2], -g[1]["runs"], g[0])
    ):
        why = entry["why"] or "No sentence was recorded."
        rows.append(
            Row(
                (
                    Cell(status, kind="refused" if refused else "failed"),
                    Cell(solver, kind="method"),
                    Cell(str(entry["runs"]), kind="number"),
                    Cell(why),
                    Cell(join_names(entry["cases"], 8)),
                ),
                solver=solver,
            )
        )
    return Table(
        "failures",
        ("status", "method", "runs", "sentence", "cases"),
        tuple(rows),
        "Sentences that differ only in their numbers are counted together; the first one is shown."
        if rows
        else "Every run attempted reached its end time with a number.",
    )


def seeds_table(data: Data) -> Table:
    """Methods on families of cases that differ only in their seed: how often they fail, and whether
    they say so."""
    groups: dict = {}
    for (case, solver), runs in data.runs.items():
        if re.search(r"[\[,]seed=", case):
            base = re.sub(
                r"\[\]$", "", re.sub(r"(?<=\[),", "", re.sub(r",?seed=[^,\]]*", "", case))
            )
            groups.setdefault((base, solver), []).append(runs)
    rows = []
    for (base, solver), group in groups.items():
        if len(group) < 2:
            continue
        bad = [r for r in group if count_finished(r) < len(r)]
        codes = format_statuses(sum_statuses(bad)) if bad else "none"
        rows.append(
            Row(
                (
                    Cell(solver, kind="method"),
                    Cell(str(len(group)), kind="number"),
                    Cell(str(len(bad)), kind="number" if not bad else "bad"),
                    Cell(codes),
                ),
                base,
                solver,
            )
        )
    return Table(
        "seeds",
        ("method", "seeds", "with a failure", "statuses"),
        tuple(rows),
        "A seed counts as failed when any of its runs ended without a number.",
    )


def sum_statuses(group):
    from collections import Counter

    total = Counter(s for r in group for s in r.col["status"].tolist())
    for code in ("ok", "below_reference"):
        total.pop(code, None)
    return total


def _plain(value) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{k} {v}" for k, v in value.items())
    return " ".join(map(str, value)) if isinstance(value, (list, tuple)) else str(value)


def environment_table(env: dict) -> Table:
    """env.json, one line per entry."""
    rows = [
        Row((Cell(sanitise(k, 80), kind="method"), Cell(sanitise(_plain(v)) or "empty")))
        for k, v in env.items()
    ]
    return Table(
        "environment",
        ("what", "value"),
        tuple(rows),
        "" if rows else "The study stored no environment: its figures cannot be tied to a machine.",
    )


GLOSSARY = {  # words of the report that are no columns; those are described in nsbench.columns
    "order, interval": "p of error = C h^p (1 + r h^q)^s in the fit window, the slope of log "
    "error over log h that the error tends to, with its t-based 95 % interval; kept negative when "
    "a method diverges",
    "constant": "C in error = C h^p, of the finest steps",
    "exact at grid times": "the error is rounding at every step, so that no order can be fitted "
    "(Euler is exact for a constant drift)",
    "plateau": "the error tends to C > 0: the method converges to a limit of its own",
    "pre-asymptotic, undecided": "too few points, or too erratic, for a verdict; an answer, not "
    "an omission",
    "reference floor": "an error below it says more of the reference than of the method and is "
    "not a number",
    "counted work": "drift calls + projections + inner iterations (QP solves where those are not "
    "counted)",
    "compiled, host": "whether the loop over steps runs as machine code or in the Python "
    "interpreter; seconds are compared only within a kind",
    "claimed": f"the order a solver's file claims. A deviation is marked when the claim lies "
    f"outside the interval and more than {0.1:g} away",
}


def glossary_table(data: Data) -> Table:
    """Words of the report, then every column that holds a value in this study, its unit beside
    it."""
    rows = [Row((Cell(k, kind="method"), Cell(v))) for k, v in GLOSSARY.items()]
    for name in _held(data):
        column = describe(name)
        title = column.title if column.title == name else f"{column.title} ({name})"
        unit = f" [{column.unit}]" if column.unit else ""
        rows.append(
            Row((Cell(sanitise(title, 80), kind="method"), Cell(f"{column.meaning}{unit}")))
        )
    return Table("glossary", ("word", "meaning"), tuple(rows))


def _held(data: Data) -> list[str]:
    """Names of the columns in which some run of the study holds a value."""
    held: dict = {}
    for runs in data.runs.values():
        for name, values in runs.col.items():
            if name not in held and np.any(
                np.isfinite(values) if values.dtype == np.float64 else values != ""
            ):
                held[name] = None
    first = next(iter(data.runs.values()), None)
    return [name for name in (first.col if first else ()) if name in held]


def counts_line(summaries: dict[tuple, Summary]) -> str:
    """``24 runs of 3 methods on 2 cases``."""
    runs = sum(len(s.runs) for s in summaries.values())
    return (
        f"{format_count(runs, 'run')} of {format_count(len({k[1] for k in summaries}), 'method')} "
        f"on {format_count(len({k[0] for k in summaries}), 'case')}"
    )
