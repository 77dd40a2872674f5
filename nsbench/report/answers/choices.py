"""Write the sentences that answer which method is the best at an error (best_method.RULE)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np

from nsbench.columns import ABSOLUTE
from nsbench.report import cost
from nsbench.report.answers.best_method import Best, best_of_page, count_best
from nsbench.report.answers.grouping import Summaries
from nsbench.report.data import Data
from nsbench.report.style import format_count, format_power, format_seconds, join_names, sanitise


def write_headline(data: Data, summaries: Summaries) -> str:
    """Write the answer in a sentence: which methods are the best at the second of the targets.

    Where no error is known, or runs are missing, the sentence says so.
    """
    if data.lacking:
        return say_lacking(data)
    found = list(write_choices(data, summaries))
    return found[min(1, len(found) - 1)] if found else "No run gave an error to compare."


def say_lacking(data: Data) -> str:
    """Say how many runs are missing: the next of them may reach an error that none has reached."""
    return f"{data.lacking[0].upper()}{data.lacking[1:]}: no verdict is given yet."


def write_choices(data: Data, summaries: Summaries) -> Iterator[str]:
    """Say which method is the best on one case, or on how many of several, error by error."""
    cases = [case for case in data.case_keys if _has_error(data, case)]
    for target in cost.TARGETS if cases else ():
        found = {case: best_of_page(data, summaries, case, target) for case in cases}
        what = f"State error {format_power(target)} ({ABSOLUTE})"
        yield f"{what}: {_one(*found.values()) if len(found) == 1 else _several(found)}."
    blind = [case for case in data.case_keys if case not in cases]
    if blind:
        yield (
            "Errors are not known, for want of a reference or of a finished run: "
            f"{join_names([_with_reason(data, case) for case in blind])}."
        )


def _one(best: Best) -> str:
    """Say which method is the best on the only case, and which would be cheaper."""
    if best.cost is None:
        return "reached by no method"
    if not best.reached:
        needs = cost.format_extrapolated(best.cost)
        return f"reached by no run; best by its order is {best.cost.solver}, which {needs}"
    bound = "≤ " if best.cost.at_most else ""
    setting = f"{cost.format_setting(best.cost)}, {bound}{format_seconds(best.cost.seconds)}"
    setting += ", host loop" if best.cost.loop == "host" else ""
    tail = ""
    if best.further is not None:
        needs = cost.format_extrapolated(best.further)
        tail = f"; {best.further.solver} would take less time by its order, but {needs}"
    return f"the cheapest is {best.cost.solver} ({setting}){tail}"


def _several(found: dict[str, Best]) -> str:
    """Count on how many cases each method is the best; found: by case."""
    reached = [best for best in found.values() if best.reached]
    missed = [case for case, best in found.items() if not best.reached]
    by_order = Counter(b.cost.solver for b in found.values() if b.cost and not b.reached)
    further = [case for case, best in found.items() if best.further is not None]
    tail = ""
    if by_order:
        names = ", ".join(f"{solver} on {n}" for solver, n in by_order.most_common(4))
        tail = f"; by their orders smaller steps than were run would reach it there: {names}"
    if not reached:
        return f"reached by no run on any case{tail}"
    first = count_best(reached)
    names = ", ".join(f"{solver} on {n}" for solver, n in first.most_common(4))
    others = first.total() - sum(n for _, n in first.most_common(4))
    names += f", others on {others}" if others else ""
    if missed:
        tail = f"; reached by no run on {join_names(missed, 4)}{tail}"
    if further:
        tail += (
            f"; with smaller steps than were run others would be, by their orders, on "
            f"{join_names(further, 4)}"
        )
    return f"cheapest is {names} of {format_count(len(found), 'case')}{tail}"


def _with_reason(data: Data, case: str) -> str:
    """Return a case with the reason why it has no reference, as far as that is stored."""
    stored = data.cases.get(case, {})
    why = (stored.get("certificate") or {}).get("how", "")
    return f"{case} ({sanitise(why)})" if why and stored.get("reference") == "none" else case


def _has_error(data: Data, case: str) -> bool:
    """Does any run of the case have a state error?"""
    return any(np.isfinite(r.col["state_sup"][r.good]).any() for r in data.of_case(case))
