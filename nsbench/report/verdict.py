"""Write the opening sentences: which method, which orders, which multipliers, what failed.

Every number in them is computed from the rows; no sentence is written where it has no subject.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from nsbench.columns import RELATIVE
from nsbench.report import cost
from nsbench.report.answers.choices import say_lacking, write_choices
from nsbench.report.answers.grouping import (
    LEVELS,
    Summaries,
    by_solver,
    describe_order,
    join_pairs,
    spread,
    without_verdict,
)
from nsbench.report.answers.multipliers import judge_multipliers
from nsbench.report.data import Data
from nsbench.report.expectations import judge_expectations, new_deviations, resolved_deviations
from nsbench.report.style import (
    format_count,
    format_number,
    format_power,
    join_names,
)
from nsbench.report.summary import Summary, find_silent_failures, format_statuses
from nsbench.trajectory import NO_FAILURE

MAX_DEVIATIONS = 12  # listed in the opening; the table has them all
MULTIPLIERS = "Can the multipliers be trusted"  # head of a statement
FAILED = "What failed"  # head of a statement


@dataclass(frozen=True)
class Statement:
    """A short heading with its sentences; tone: "plain" or "bad"."""

    head: str
    sentences: tuple[str, ...]
    tone: str = "plain"


def write_verdict(data: Data, summaries: Summaries) -> list[Statement]:
    """Write what a reader in a hurry needs; at least one statement, also when nothing ran.

    While runs are missing, only what no further run can change: what went wrong.
    """
    if data.lacking:
        parts = [Statement("Not finished", (say_lacking(data),), "bad")]
        return [*parts, *_wrong(summaries), _ended(summaries)]
    if not any(s.word == "ok" for s in summaries.values()):
        return [Statement("No run gave a number", (_runs(summaries), *_failed(summaries)), "bad")]
    parts = [
        Statement("Which method", tuple(write_choices(data, summaries))),
        Statement("Which orders", tuple(_orders(data, summaries))),
        Statement(MULTIPLIERS, tuple(judge_multipliers(data, summaries))),
        Statement("Which step", tuple(_violations(data, summaries))),
        Statement("At equal error", tuple(cost.compare_speeds(data))),
    ]
    parts += _unexpected(judge_expectations(data, summaries))
    parts += [*_wrong(summaries), _ended(summaries)]
    return [p for p in parts if p.sentences]


def _wrong(summaries: Summaries) -> list[Statement]:
    """State which methods called a run ok that breaks the bound they claim."""
    found = find_silent_failures(summaries)
    said = tuple(f"{s.solver} on {s.case}, called ok: {s.state.sentence}" for s in found)
    return [Statement("Wrong without a word", said, "bad")] if said else []


def _ended(summaries: Summaries) -> Statement:
    """State how the runs ended."""
    return Statement(FAILED, (_runs(summaries), *_failed(summaries)))


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


def _orders(data: Data, summaries: Summaries) -> Iterator[str]:
    """Report state orders: as claimed, off the claim, bounds, and where there is no verdict."""
    pairs = [(s, s.state) for s in summaries.values() if s.word == "ok"]
    yield from _orders_as_claimed(by_solver(summaries))
    for head, test in (
        ("Below the claim", lambda o: o.kind == "fit" and o.flag == "below"),
        ("Above the claim", lambda o: o.kind == "fit" and o.flag == "above"),
        ("A limit of its own, or none", lambda o: o.verdict in LEVELS and not o.flag),
    ):
        found = [(s, o) for s, o in pairs if test(o)]
        if found:
            yield f"{head}: {join_pairs(found, describe_order)}."
    for name, group in by_solver(summaries).items():
        bounded = [s for s in group if s.state.kind == "bound"]
        if bounded:
            yield _bound_sentence(data, name, bounded)
    exact = list(dict.fromkeys(s.case for s, o in pairs if o.kind == "exact"))
    if exact:
        yield (
            "Exact at grid times for at least one method, hence no order there: "
            f"{join_names(exact)}."
        )
    yield from without_verdict(pairs)


def _orders_as_claimed(solvers: dict[str, list[Summary]]) -> Iterator[str]:
    """Report methods all of whose fitted orders are as claimed, and those that claim none."""
    fits = {
        name: [s.state for s in group if s.state.verdict == "order"]
        for name, group in solvers.items()
    }
    claiming = {
        name: found
        for name, orders in fits.items()
        if (found := [o for o in orders if o.claim is not None])
    }
    as_claimed = {
        name: orders for name, orders in claiming.items() if not any(o.flag for o in orders)
    }
    for claim in sorted({orders[0].claim for orders in as_claimed.values()}):
        methods = "; ".join(
            f"{name} {spread(orders)}"
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
        yield f"As claimed on some cases, the others below or above: {'; '.join(some)}."
    free = [
        f"{name} {spread(orders)}"
        for name, orders in fits.items()
        if orders and name not in claiming
    ]
    if free:
        yield f"State order where none is claimed: {'; '.join(free)}."


def _bound_sentence(data: Data, name: str, bounded: list[Summary]) -> str:
    """Count the cases on which a method keeps the error bound that it claims.

    Cases whose reference is made of runs of this method are named: there it is held against itself.
    """
    missed = [s for s in bounded if s.state.flag]
    undecided = [s.case for s in bounded if s.state.verdict == "below reference"]
    decided = len(bounded) - len(undecided)
    kept = f"kept on {decided - len(missed)} of {format_count(decided, 'case')}"
    tail = kept if decided else ""
    if missed:
        cases = join_names([f"{s.case} ({describe_order(s.state)})" for s in missed], 4)
        tail += f"; missed on {cases}"
    if undecided:
        tail += f"{'; ' if tail else ''}not known to be kept on {join_names(undecided, 4)}, where "
        tail += "the reference is not good enough to tell"
    own = [s.case for s in bounded if _references_itself(data, s)]
    if own:
        tail += (
            f"; the reference is two runs of this method, by different integrators, on "
            f"{join_names(own, 8)}"
        )
    return (
        f"{name}: the bound of the state error that it claims, "
        f"{format_number(bounded[0].state.claim)} ({RELATIVE}), is {tail}."
    )


def _references_itself(data: Data, s: Summary) -> bool:
    """Is the reference of the case made of runs of the method, without a proof?"""
    stored = data.cases.get(s.case, {})
    how = str((stored.get("certificate") or {}).get("how", ""))
    return stored.get("reference") == "stored" and how.startswith(f"{s.solver} at ")


def _violations(data: Data, summaries: Summaries) -> Iterator[str]:
    """Report the step that keeps the constraints on all cases, and the case that needs it.

    Violations are parts of the length that a case has of its own; of cases without one, numbers.
    """
    lengths = {case: known.get("own_length") for case, known in data.cases.items()}
    measured = [s for s in summaries.values() if s.runs.violates]
    with_length = {(s.case, s.solver): s for s in measured if lengths.get(s.case)}
    without = {(s.case, s.solver): s for s in measured if not lengths.get(s.case)}
    for part in (1e-2, 1e-3):
        for group, limit in (
            (with_length, f"{100 * part:g} % of the diameter or stated size"),
            (without, format_power(part)),
        ):
            yield from _largest_steps(group, lambda s: part * (lengths.get(s.case) or 1.0), limit)


def _largest_steps(
    summaries: Summaries, target: Callable[[Summary], float], limit: str
) -> Iterator[str]:
    """Report, in one sentence, the step of each method with violations of at most `target`."""
    reached = []
    missed = []
    for solver, group in by_solver(summaries).items():
        found = {s.case: cost.step_for_violation(s.runs, target(s)) for s in group}
        steps = [(c.h, case) for case, c in found.items() if c is not None and c.h > 0]
        if steps:
            h, case = min(steps)
            of = f"{len(steps)} of {format_count(len(found), 'case')}"
            reached.append(f"{solver} h = {format_number(h)} ({case}; {of})")
        missed += [f"{solver} on {case}" for case, c in found.items() if c is None]
    if reached:
        tail = f"; not reached by {join_names(missed, 4)}" if missed else ""
        yield (
            f"Violation below {limit} on every case that reaches it: {', '.join(reached)}{tail}."
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
