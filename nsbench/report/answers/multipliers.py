"""Write the sentences on the multipliers: do they converge, and what is compared of them?"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from nsbench.measure.compared_multiplier import NOT_UNIQUE
from nsbench.report.answers.best_method import TARGET, best_of_page
from nsbench.report.answers.grouping import (
    LEVELS,
    Summaries,
    by_solver,
    describe_order,
    join_pairs,
    spread,
    without_verdict,
)
from nsbench.report.cost import format_setting
from nsbench.report.data import Data, Runs
from nsbench.report.style import format_count, format_power, join_names
from nsbench.report.summary import Order, format_error

FEW = 3  # cases whose best method has a sentence of its own
NOT_KNOWN = "not known"


def judge_multipliers(data: Data, summaries: Summaries) -> Iterator[str]:
    """Report which multipliers converge, are exact, level off, or are not unique.

    Of few cases, what those of the best method are worth comes first.
    """
    if len(data.case_keys) <= FEW:
        yield from _of_best(data, summaries)
    solvers = by_solver(summaries)
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
        yield f"Exact: {join_pairs(exact, lambda o: '')}."
    doubtful = [(s, o) for s, o in pairs if o.verdict in LEVELS]
    if doubtful:
        yield f"Do not trust: {join_pairs(doubtful, describe_order)}."
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
    yield from without_verdict(pairs)
    yield from _compared_by_reaction(summaries)


def _of_best(data: Data, summaries: Summaries) -> Iterator[str]:
    """Say of each case what the multipliers of its best method at TARGET are worth."""
    several = len(data.case_keys) > 1
    for case in data.case_keys:
        best = best_of_page(data, summaries, case, TARGET).cost
        if best is None:
            continue
        chosen = summaries[case, best.solver]
        worth = tell_least_error(chosen.runs, chosen.force.metric)
        why = "" if worth == NOT_KNOWN else " (the least error of its runs)"
        setting = format_setting(best)
        if best.is_extrapolated:
            worth = tell_order(chosen.force)
            why = " (no run has that step)"
            setting += ", extrapolated"
        yield (
            f"Best at a state error of {format_power(TARGET)}{f' on {case}' if several else ''}: "
            f"{best.solver} ({setting}); its multipliers: {worth}{why}."
        )


def tell_least_error(runs: Runs, force: str) -> str:
    """Return the smallest error of the impulses; of the reaction where that is compared or known
    alone.

    force: impulse or reaction, whichever is compared.
    """
    for name in dict.fromkeys((force, "reaction")):
        values = runs.col[name][runs.good]
        known = values[np.isfinite(values)]
        if known.size:
            word = "" if name == "impulse" else "reaction "
            return f"{word}to {format_error(float(known.min()), runs.floor(name))}"
    return NOT_KNOWN


def tell_order(order: Order) -> str:
    """Return the order of the multipliers: no run shows the error that an extrapolated one has."""
    words = f"order {order.text}" if order.kind == "fit" else order.text
    return f"{'reaction ' if order.metric == 'reaction' else ''}{words}"


def _compared_by_reaction(summaries: Summaries) -> Iterator[str]:
    """Name the cases whose reaction is compared, and say why."""
    reasons = explain_reactions(summaries)
    nonunique = sorted(case for case, why in reasons.items() if why == NOT_UNIQUE)
    if nonunique:
        yield (
            f"Not unique, so that only the reaction can be compared: {join_names(nonunique)}. "
            "Which multiplier a method picks there is a selection, not an error."
        )
    for case, why in reasons.items():
        if case not in nonunique:
            yield f"{case}: {why}."


def explain_reactions(summaries: Summaries) -> dict[str, str]:
    """Return by case the sentence that says why its reaction is compared; others are absent."""
    found: dict[str, str] = {}
    for s in summaries.values():
        if s.runs.why_reaction and found.get(s.case) != NOT_UNIQUE:
            found[s.case] = s.runs.why_reaction
    return found


def _convergent(orders: dict[str, list[Order]]) -> str:
    """Format, by method, the range of orders of those that converge; "" without any."""
    kept = {
        name: [o for o in group if o.verdict == "order" and o.interval[0] > 0]
        for name, group in orders.items()
    }
    return "; ".join(f"{name} {spread(group)}" for name, group in kept.items() if group)
