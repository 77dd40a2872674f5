"""Choose the best method at an error: one RULE for the terminal, --json and the report."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from nsbench.report.cost import Cost, extrapolate_cost, rank_costs
from nsbench.report.data import Data
from nsbench.report.summary import Summary

TARGET = 1e-3  # state error at which a method is advised
RULE = (
    "The best method at an error is, of those whose runs reach it, the one with the fewest "
    "seconds; a host loop only where it takes fewer than every compiled loop, or where no compiled "
    "one reaches the error. Only where no run reaches it, the best is the one whose fitted order "
    "gets there in the fewest seconds, called extrapolated. A method that would take fewer "
    "seconds than the best, but only with smaller steps than were run, is named beside it."
)


@dataclass(frozen=True)
class Best:
    """The best method at an error on one case, by RULE.

    cost: of the best, None where nothing reaches the error. reached: of all methods whose runs
    reach it, as rank_costs returns them. further: of the method that would take fewer seconds than
    a best that was measured, by extrapolation; None without one.
    """

    cost: Cost | None
    reached: tuple[Cost, ...] = ()
    further: Cost | None = None


def best_at(
    data: Data, case: str, target: float, summaries: Callable[[float], Iterable[Summary]]
) -> Best:
    """Choose the best method at a state error of `target` on a case, by RULE.

    summaries: those of the methods of the case that may take fewer than some seconds, for the
    orders that extrapolation needs.
    """
    reached = tuple(rank_costs(data, case, target))
    best = cheapest(reached) if reached else None
    known = {c.solver for c in reached}
    seconds = best.seconds if best is not None else float("inf")
    others = (s for s in summaries(seconds) if s.solver not in known)
    further = cheapest_extrapolated(others, target)
    if best is None:
        return Best(further)
    return Best(best, reached, further if further and further.seconds < seconds else None)


def best_of_page(
    data: Data, summaries: dict[tuple[str, str], Summary], case: str, target: float
) -> Best:
    """Choose as best_at, from summaries by case and method."""
    own = [s for (c, _), s in summaries.items() if c == case]
    return best_at(data, case, target, lambda seconds: own)


def cheapest(found: Iterable[Cost]) -> Cost:
    """Return the cost with the fewest seconds; the first one where no seconds are known.

    found: as rank_costs returns them, at least one. A host loop that takes fewer seconds than all
    compiled ones is cheaper beyond doubt, though COMPARISON_RULE forbids a ratio.
    """
    found = list(found)
    timed = [c for c in found if c.seconds > 0.0]
    return min(timed, key=lambda c: c.seconds, default=found[0])


def cheapest_extrapolated(summaries: Iterable[Summary], target: float) -> Cost | None:
    """Return the extrapolated cost with the fewest seconds, of compiled loops if there are any."""
    found = [extrapolate_cost(s, target) for s in summaries]
    known = [c for c in found if c is not None and c.seconds > 0.0]
    return min(known, key=lambda c: (c.loop != "compiled", c.seconds), default=None)


def count_best(found: Iterable[Best]) -> Counter[str]:
    """Count on how many cases each method is the best one that reached an error with its runs."""
    return Counter(b.cost.solver for b in found if b.reached)
