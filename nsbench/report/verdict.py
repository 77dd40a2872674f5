"""Write the opening sentences: which method, which orders, which multipliers, what failed.

Every number in them is computed from the rows; no sentence is written where it has no subject.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from nsbench.report import cost
from nsbench.report.data import Data
from nsbench.report.expectations import judge_expectations, new_deviations, resolved_deviations
from nsbench.report.style import (
    format_count,
    format_number,
    format_power,
    join_names,
    sanitise,
)
from nsbench.report.summary import OPEN, Order, Summary, find_silent_failures, format_statuses
from nsbench.trajectory import NO_FAILURE

Summaries = dict[tuple[str, str], Summary]  # by (case, method)
MAX_DEVIATIONS = 12  # listed in the opening; the table has them all
MULTIPLIERS = "Can the multipliers be trusted"  # head of a statement
FAILED = "What failed"  # head of a statement
LEVELS = ("plateau", "diverges")  # verdicts of an error that does not go to zero


@dataclass(frozen=True)
class Statement:
    """A short heading with its sentences; tone: "plain" or "bad"."""

    head: str
    sentences: tuple[str, ...]
    tone: str = "plain"


def write_verdict(data: Data, summaries: Summaries) -> list[Statement]:
    """Write what a reader in a hurry needs; at least one statement, also when nothing ran."""
    if not any(s.word == "ok" for s in summaries.values()):
        return [Statement("No run gave a number", (_runs(summaries), *_failed(summaries)), "bad")]
    parts = [
        Statement("Which method", tuple(_choices(data, summaries))),
        Statement("Which orders", tuple(_orders(data, summaries))),
        Statement(MULTIPLIERS, tuple(_multipliers(summaries))),
        Statement("Which step", tuple(_violations(data, summaries))),
        Statement("At equal error", tuple(cost.compare_speeds(data))),
    ]
    parts += _unexpected(judge_expectations(data, summaries))
    wrong = find_silent_failures(summaries)
    if wrong:
        parts.append(
            Statement(
                "Wrong without a word",
                tuple(f"{s.solver} on {s.case}, called ok: {s.state.sentence}" for s in wrong),
                "bad",
            )
        )
    parts.append(Statement(FAILED, (_runs(summaries), *_failed(summaries))))
    return [p for p in parts if p.sentences]


def _unexpected(found) -> list[Statement]:
    """State new deviations from what the methods declare, and known ones that are gone."""
    sentences = [
        f"{f.solver} on {f.case}, {f.metric}: {f.expected} was expected, {f.observed} is seen."
        for f in new_deviations(found)
    ]
    sentences += [
        f"{f.solver} on {f.case}, {f.metric}: known to be “{was}”, is seen as {f.observed}: the "
        "table of known deviations is out of date."
        for f, was, _ in resolved_deviations(found)
    ]
    rest = (
        [f"{len(sentences) - MAX_DEVIATIONS} more: see the table."]
        if len(sentences) > MAX_DEVIATIONS
        else []
    )
    return (
        [Statement("Not as expected", (*sentences[:MAX_DEVIATIONS], *rest), "bad")]
        if sentences
        else []
    )


def write_headline(data: Data, summaries: Summaries) -> str:
    """Write the answer in a sentence: which methods are the cheapest at the second of the targets.

    Where no error is known, the sentence says so.
    """
    found = list(_choices(data, summaries))
    return found[min(1, len(found) - 1)] if found else "No run gave an error to compare."


def _choices(data: Data, summaries: Summaries) -> Iterator[str]:
    """Count on how many cases each method is the cheapest one to reach an error."""
    cases = [case for case in data.case_keys if _has_error(data, case)]
    for target in cost.TARGETS if cases else ():
        found = {case: cost.rank_costs(data, case, target) for case in cases}
        if not any(found.values()):
            yield f"Error {format_power(target)}: reached by no method on any case."
            continue
        first = cost.count_cheapest(found.values())
        best = ", ".join(f"{solver} on {n}" for solver, n in first.most_common(4))
        others = first.total() - sum(n for _, n in first.most_common(4))
        best += f", others on {others}" if others else ""
        missed = [case for case, c in found.items() if not c]
        tail = f"; not reached on {join_names(missed, 4)}" if missed else ""
        further = [c for c in cases if _further(summaries, c, found[c], target) is not None]
        if further:
            tail += (
                f"; with smaller steps than were run others would be, by their orders, on "
                f"{join_names(further, 4)}"
            )
        yield (
            f"Error {format_power(target)}: cheapest is {best} of "
            f"{format_count(len(cases), 'case')}{tail}."
        )
    blind = [case for case in data.case_keys if case not in cases]
    if blind:
        yield (
            "Errors are not known, for want of a reference or of a finished run: "
            f"{join_names([_with_reason(data, case) for case in blind])}."
        )


def _further(summaries: Summaries, case: str, found: list, target: float) -> cost.Cost | None:
    """Return the extrapolated cost that is below all that were found on a case, if there is one."""
    own = (s for (c, _), s in summaries.items() if c == case)
    return cost.cheaper_extrapolated(own, found, target)


def _with_reason(data: Data, case: str) -> str:
    """Return a case with the reason why it has no reference, as far as that is stored."""
    stored = data.cases.get(case, {})
    why = (stored.get("certificate") or {}).get("how", "")
    return f"{case} ({sanitise(why)})" if why and stored.get("reference") == "none" else case


def _has_error(data: Data, case: str) -> bool:
    """Does any run of the case have a state error?"""
    return any(np.isfinite(r.col["state_sup"][r.good]).any() for r in data.of_case(case))


def _by_solver(summaries: Summaries) -> dict[str, list[Summary]]:
    """Group the summaries with numbers by method."""
    out: dict = {}
    for s in summaries.values():
        if s.word == "ok":
            out.setdefault(s.solver, []).append(s)
    return out


def _spread(orders: list[Order]) -> str:
    """Format the range of orders: ``1.00 (1 case)`` or ``0.97 to 1.02 (3 cases)``."""
    values = [o.order for o in orders]
    low = f"{min(values):.2f}"
    high = f"{max(values):.2f}"
    return f"{low if low == high else f'{low} to {high}'} ({format_count(len(values), 'case')})"


def _pairs(group: list[tuple[Summary, Order]], describe: Callable[[Order], str]) -> str:
    """Format pairs of method and case: ``pbd on tide (0.52) and hex (plateau at 2e-3)``.

    Every method is named once; beyond four cases the rest is counted. describe: words for an Order.
    """
    cases_of: dict = {}
    for s, o in group:
        cases_of.setdefault(s.solver, []).append(
            f"{s.case} ({describe(o)})" if describe(o) else s.case
        )
    return "; ".join(f"{solver} on {join_names(cases, 4)}" for solver, cases in cases_of.items())


def _describe_order(o: Order) -> str:
    """Format an order, a bound or a plateau for a sentence."""
    if o.kind == "bound":
        return o.text
    if o.verdict == "plateau" and o.plateau == o.plateau:
        return f"plateau at {format_number(o.plateau)}"
    return f"order {o.order:.2f}"


def _orders(data: Data, summaries: Summaries) -> Iterator[str]:
    """Report state orders: as claimed, off the claim, bounds, and where there is no verdict."""
    pairs = [(s, s.state) for s in summaries.values() if s.word == "ok"]
    yield from _orders_as_claimed(_by_solver(summaries))
    for head, test in (
        ("Below the claim", lambda o: o.kind == "fit" and o.flag == "below"),
        ("Above the claim", lambda o: o.kind == "fit" and o.flag == "above"),
        (
            "A limit of its own, or none",
            lambda o: o.verdict in LEVELS and not o.flag,
        ),
    ):
        found = [(s, o) for s, o in pairs if test(o)]
        if found:
            yield f"{head}: {_pairs(found, _describe_order)}."
    for name, group in _by_solver(summaries).items():
        bounded = [s for s in group if s.state.kind == "bound"]
        if bounded:
            yield _bound_sentence(data, name, bounded)
    exact = list(dict.fromkeys(s.case for s, o in pairs if o.kind == "exact"))
    if exact:
        yield (
            "Exact at grid times for at least one method, hence no order there: "
            f"{join_names(exact)}."
        )
    yield from _without_verdict(pairs)


def _orders_as_claimed(solvers: dict[str, list[Summary]]) -> Iterator[str]:
    """Report methods all of whose fitted orders are as claimed, and those that claim none."""
    fits = {
        name: [s.state for s in group if s.state.verdict == "order"]
        for name, group in solvers.items()
    }
    claiming = {
        name: orders for name, orders in fits.items() if orders and orders[0].claim is not None
    }
    as_claimed = {
        name: orders for name, orders in claiming.items() if not any(o.flag for o in orders)
    }
    for claim in sorted({orders[0].claim for orders in as_claimed.values()}):
        methods = "; ".join(
            f"{name} {_spread(orders)}"
            for name, orders in as_claimed.items()
            if orders[0].claim == claim
        )
        yield (
            f"State order {format_number(claim)}, as claimed, wherever it can be fitted: {methods}."
        )
    some = [
        f"{name} {format_number(orders[0].claim)} on {sum(not o.flag for o in orders)} of "
        f"{format_count(len(orders), 'case')}"
        for name, orders in claiming.items()
        if name not in as_claimed
    ]
    if some:
        yield f"As claimed on some cases, the others below: {'; '.join(some)}."
    free = [
        f"{name} {_spread(orders)}"
        for name, orders in fits.items()
        if orders and orders[0].claim is None
    ]
    if free:
        yield f"State order where none is claimed: {'; '.join(free)}."


def _bound_sentence(data: Data, name: str, bounded: list[Summary]) -> str:
    """Count the cases on which a method keeps the error bound that it claims.

    Cases whose reference is made of runs of this method are named: there it is held against itself.
    """
    missed = [s for s in bounded if s.state.flag]
    undecided = [s.case for s in bounded if s.state.verdict == "below reference"]
    tail = ""
    if missed:
        cases = join_names([f"{s.case} ({_describe_order(s.state)})" for s in missed], 4)
        tail += f"; missed on {cases}"
    if undecided:
        tail += f"; the reference is not good enough to tell on {join_names(undecided, 4)}"
    own = [s.case for s in bounded if _references_itself(data, s)]
    if own:
        tail += (
            f"; the reference is two runs of this method, by different integrators, on "
            f"{join_names(own, 8)}"
        )
    return (
        f"{name}: the bound it claims, {format_number(bounded[0].state.claim)}, is kept on "
        f"{len(bounded) - len(missed) - len(undecided)} of "
        f"{format_count(len(bounded), 'case')}{tail}."
    )


def _references_itself(data: Data, s: Summary) -> bool:
    """Is the reference of the case made of runs of the method, without a proof?"""
    stored = data.cases.get(s.case, {})
    how = str((stored.get("certificate") or {}).get("how", ""))
    return stored.get("reference") == "stored" and how.startswith(f"{s.solver} at ")


def _without_verdict(pairs: list[tuple[Summary, Order]]) -> Iterator[str]:
    """Count the pairs of method and case whose fit has no verdict."""
    undecided = [s for s, o in pairs if o.verdict in OPEN]
    if undecided:
        cases = join_names(dict.fromkeys(s.case for s in undecided), 4)
        yield (
            f"No verdict (undecided or pre-asymptotic): {len(undecided)} of "
            f"{format_count(len(pairs), 'pair')} of a method and a case, on {cases}."
        )


def _multipliers(summaries: Summaries) -> Iterator[str]:
    """Report which multipliers converge, are exact, level off, or are not unique."""
    solvers = _by_solver(summaries)
    pairs = [(s, s.force) for s in summaries.values() if s.word == "ok"]
    for metric in ("impulse", "reaction"):
        orders = {
            name: [s.force for s in group if s.force.metric == metric]
            for name, group in solvers.items()
        }
        if methods := _convergent(orders):
            yield f"The {metric} converges, with order: {methods}."
    exact = [(s, o) for s, o in pairs if o.kind == "exact"]
    if exact:
        yield f"Exact: {_pairs(exact, lambda o: '')}."
    doubtful = [(s, o) for s, o in pairs if o.verdict in LEVELS]
    if doubtful:
        yield f"Do not trust: {_pairs(doubtful, _describe_order)}."
    else:
        judged = sum(o.verdict == "order" for _, o in pairs)
        if judged:
            yield (
                "No impulse or reaction was found to level off or to diverge "
                f"({format_count(judged, 'pair')} of a method and a case with an order)."
            )
    single = {name: [s.settled for s in group] for name, group in solvers.items()}
    if methods := _convergent(single):
        yield (
            "At single times multipliers converge away from events, as means over a sample "
            f"interval, with order: {methods}."
        )
    yield from _without_verdict(pairs)
    nonunique = sorted({s.case for s in summaries.values() if s.force.metric == "reaction"})
    if nonunique:
        yield (
            f"Not unique, so that only the reaction can be compared: {join_names(nonunique)}. "
            "Which multiplier a method picks there is a selection, not an error."
        )


def _convergent(orders: dict[str, list[Order]]) -> str:
    """Format, by method, the range of orders of those that converge; "" without any."""
    kept = {
        name: [o for o in group if o.verdict == "order" and o.interval[0] > 0]
        for name, group in orders.items()
    }
    return "; ".join(f"{name} {_spread(group)}" for name, group in kept.items() if group)


def _violations(data: Data, summaries: Summaries) -> Iterator[str]:
    """Report the step that keeps the constraints on all cases, and the case that needs it."""
    for target in (1e-2, 1e-3):
        reached = []
        missed = []
        for solver, group in _by_solver(summaries).items():
            found = {
                s.case: cost.step_for_violation(s.runs, target) for s in group if s.runs.violates
            }
            steps = [(c.h, case) for case, c in found.items() if c is not None and c.h > 0]
            if steps:
                h, case = min(steps)
                of = f"{len(steps)} of {format_count(len(found), 'case')}"
                reached.append(f"{solver} h = {format_number(h)} ({case}; {of})")
            missed += [f"{solver} on {case}" for case, c in found.items() if c is None]
        if reached:
            tail = f"; not reached by {join_names(missed, 4)}" if missed else ""
            yield (
                f"Violation below {format_power(target)} on every case that reaches it: "
                f"{', '.join(reached)}{tail}."
            )


def _runs(summaries: Summaries) -> str:
    """Count the runs by how they ended."""
    total = sum((s.statuses for s in summaries.values()), Counter())
    good = total.pop("ok", 0)
    below = total.pop("below_reference", 0)
    refused = total.pop("refused", 0)
    unsure = total.pop("unverified", 0)
    runs = good + below + refused + unsure + sum(total.values())
    text = f"Of {format_count(runs, 'run')} {good} ended ok"
    text += f", {below} below the reference's own error" if below else ""
    text += f", {refused} refused by the method" if refused else ""
    text += f", {unsure} unverified" if unsure else ""
    return text + (
        f", {sum(total.values())} failed: {format_statuses(total)}." if total else ", none failed."
    )


def _failed(summaries: Summaries) -> Iterator[str]:
    """List the cases on which each method gave no number, or not at every accuracy."""
    for solver in dict.fromkeys(s.solver for s in summaries.values()):
        never = [s.case for s in summaries.values() if s.solver == solver and s.word == "failed"]
        some = [
            s.case
            for s in summaries.values()
            if s.solver == solver and s.word == "ok" and set(s.statuses) - set(NO_FAILURE)
        ]
        if never:
            yield f"{solver} gave no number on {join_names(never)}."
        if some:
            yield f"{solver} failed at some accuracies on {join_names(some)}."
