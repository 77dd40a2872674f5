"""Tabulate costs at equal error: the cheapest method, and factors over PBD."""

from __future__ import annotations

import numpy as np

from nsbench.columns import ABSOLUTE
from nsbench.report.answers.best_method import (
    RULE,
    Best,
    best_of_page,
    cheapest_extrapolated,
    count_best,
)
from nsbench.report.cost import (
    TARGETS,
    Cost,
    extrapolate_cost,
    format_extrapolated,
    format_setting,
    least_error,
    rank_costs,
    ratio_of_seconds,
    ratio_of_work,
    select_baseline,
    why_not_comparable,
)
from nsbench.report.data import Data
from nsbench.report.style import (
    LEADING_METHOD,
    TIMES,
    format_count,
    format_factor,
    format_number,
    format_power,
    format_seconds,
    method_of,
)
from nsbench.report.summary import Summary
from nsbench.report.tables.cells import Cell, Row, Table

Summaries = dict[tuple[str, str], Summary]  # by case and method


def ranking_table(data: Data, summaries: Summaries) -> Table:
    """Build the table method x error: on how many cases it reaches the error and is the best.

    Where it reaches it on none: how near it came, and the step it needs by extrapolation. Methods
    come by the number of cases on which they reach the smallest errors.
    """
    best = {t: [best_of_page(data, summaries, c, t) for c in data.case_keys] for t in TARGETS}
    ranked = {t: [b.reached for b in found] for t, found in best.items()}
    if not any(found for costs in ranked.values() for found in costs):
        return Table("ranking", (), ())
    specs = {solver for _, solver in summaries}
    reached = {
        s: [sum(any(c.solver == s for c in found) for found in ranked[t]) for t in TARGETS]
        for s in specs
    }
    first = {t: count_best(best[t]) for t in TARGETS}
    rows = []
    for solver in sorted(specs, key=lambda s: (*(-n for n in reversed(reached[s])), s)):
        cells = [Cell(solver, kind="method")]
        tried = [s for (_, name), s in summaries.items() if name == solver]
        for target, n in zip(TARGETS, reached[solver], strict=True):
            if not n:
                cells.append(_shortfall(tried, target, len(data.case_keys) > 1))
                continue
            own = [c for found in ranked[target] for c in found if c.solver == solver]
            hosted = own and all(c.loop != "compiled" for c in own) and not first[target][solver]
            won = "not compared" if hosted else f"cheapest on {first[target][solver]}"
            cells.append(Cell(f"reached on {n}", won, kind="number"))
        rows.append(Row(tuple(cells), solver=solver))
    return Table(
        "ranking",
        ("method", *(f"error {format_power(t)}" for t in TARGETS)),
        tuple(rows),
        f"Of {format_count(len(data.case_keys), 'case')}. A method that refuses a case does not "
        f"reach its error. {RULE} Best so far: the least error of a finest run.",
    )


def _shortfall(tried: list[Summary], target: float, names_case: bool) -> Cell:
    """How near a method came to an error that it reaches on no case, and what would reach it.

    names_case: name the case of the least error, and that of the fewest extrapolated seconds.
    """
    name = lambda summary: f" ({summary.runs.case})" if names_case else ""
    known = [(e, s) for s in tried if np.isfinite(e := least_error(s.runs))]
    if not known:
        return Cell("not reached", "no error known", kind="quiet")
    best, nearest = min(known, key=lambda pair: pair[0])
    found = cheapest_extrapolated(tried, target)
    further = "" if found is None else format_extrapolated(found)
    text = f"not reached; best {format_number(best)}{name(nearest)}"
    case = next((s for s in tried if further and extrapolate_cost(s, target) == found), None)
    return Cell(text, further + (name(case) if case else ""), kind="quiet")


def choice_table(data: Data, summaries: Summaries) -> Table:
    """Build the table case x error of the cheapest method.

    By seconds, by counted work where there are none.
    """
    rows = []
    if not any(np.isfinite(r.col["state_sup"][r.good]).any() for r in data.runs.values()):
        return Table("choice", (), ())
    for case in data.case_keys:
        cells = [Cell(case, kind="method")]
        for target in TARGETS:
            blind = not any(
                np.isfinite(r.col["state_sup"][r.good]).any() for r in data.of_case(case)
            )
            best = best_of_page(data, summaries, case, target)
            cells.append(
                Cell("no error known", kind="quiet") if blind else _choice(best, target)
            )
        rows.append(Row(tuple(cells)))
    return Table(
        "choice",
        ("case", *(f"error {format_power(t)}" for t in TARGETS)),
        tuple(rows),
        "The cheapest method whose state error stays below the figure at all smaller steps, with "
        "the accuracy it needs, interpolated between its runs and rounded: on the safe side is the "
        f"next smaller step. Errors are {ABSOLUTE}, the largest over all samples and coordinates. "
        f"{RULE} “Host loop”: the seconds of that method measure the interpreter. "
        "“Extrapolated”: the step is where the lower end of the fitted order gets there.",
    )


def _choice(best: Best, target: float) -> Cell:
    """The best method at `target`; the others in the title."""
    if best.cost is None:
        return Cell("not reached", kind="quiet", title=_missed(target))
    first = best.cost
    if not best.reached:
        return Cell(first.solver, format_extrapolated(first), _missed(target), "quiet")
    bound = "at most " if first.at_most else ""
    small = f"{bound}{format_seconds(first.seconds)}, {format_setting(first)}"
    if first.loop != "compiled":
        small += f", {first.loop or 'unmarked'} loop"
    if best.further is not None:
        small += f"; {best.further.solver} {format_extrapolated(best.further)}"
    others = ", ".join(
        f"{c.solver} {format_seconds(c.seconds)}" for c in best.reached if c is not first
    )
    title = f"Also reached by: {others}." if others else "No other method reached it."
    return Cell(first.solver, small, title, "best")


def _missed(target: float) -> str:
    return f"No run stayed below {format_power(target)}."


def speed_table(data: Data, summaries: Summaries) -> Table:
    """Build the table case x method of seconds at equal error, with the factor over PBD."""
    rows = []
    for case in data.case_keys:
        by_target = {t: rank_costs(data, case, t) for t in TARGETS}
        finished = [r for r in data.of_case(case) if r.good.any()]
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
                if any(method_of(r.solver) == LEADING_METHOD for r in finished)
                else f"no {LEADING_METHOD} here"
            )
            summary = summaries[case, runs.solver]
            for t in TARGETS:
                further = None if mine[t] else extrapolate_cost(summary, t)
                cells.append(_speed(mine[t], select_baseline(by_target[t]), absent, further))
            rows.append(Row(tuple(cells), case, runs.solver))
    return Table(
        "speed",
        ("method", *(f"error {format_power(t)}" for t in TARGETS)),
        tuple(rows),
        "Seconds to a state error, interpolated on the work-precision curve, and their factor "
        "over PBD. ≤: the coarsest run tried was already better, so that no factor can be given; "
        "“work” is the factor in drift calls + projections + inner iterations, for loops of "
        "different kinds.",
    )


def _speed(cost: Cost | None, base: Cost | None, absent: str, further: Cost | None) -> Cell:
    """Seconds of one method with its factor over `base`; absent: why there is no base.

    further: the extrapolated cost of an error that was not reached, if there is one.
    """
    if further is not None:
        return Cell("not reached", format_extrapolated(further), kind="quiet")
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
    ratio = ratio_of_seconds(cost, base)
    work = ratio_of_work(cost, base)
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
        spread if ratio else f"Not compared in seconds: {why_not_comparable(cost, base)}.",
        "number",
    )
