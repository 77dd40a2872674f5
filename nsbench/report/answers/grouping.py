"""Group the summaries of a report by method, and format groups of orders for its sentences."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from nsbench.report.style import format_count, format_number, join_names
from nsbench.report.summary import OPEN, Order, Summary

Summaries = dict[tuple[str, str], Summary]  # by (case, method)
LEVELS = ("plateau", "diverges")  # verdicts of an error that does not go to zero


def by_solver(summaries: Summaries) -> dict[str, list[Summary]]:
    """Group the summaries with numbers by method."""
    out: dict = {}
    for s in summaries.values():
        if s.word == "ok":
            out.setdefault(s.solver, []).append(s)
    return out


def spread(orders: list[Order]) -> str:
    """Format the range of orders: ``1.00 (1 case)`` or ``0.97 to 1.02 (3 cases)``."""
    values = [o.order for o in orders]
    low = f"{min(values):.2f}"
    high = f"{max(values):.2f}"
    return f"{low if low == high else f'{low} to {high}'} ({format_count(len(values), 'case')})"


def join_pairs(group: list[tuple[Summary, Order]], describe: Callable[[Order], str]) -> str:
    """Format pairs of method and case: ``pbd on tide (0.52) and hex (plateau at 2e-3)``.

    Every method is named once; beyond four cases the rest is counted. describe: words for an Order.
    """
    cases_of: dict = {}
    for s, o in group:
        cases_of.setdefault(s.solver, []).append(
            f"{s.case} ({describe(o)})" if describe(o) else s.case
        )
    return "; ".join(f"{solver} on {join_names(cases, 4)}" for solver, cases in cases_of.items())


def describe_order(o: Order) -> str:
    """Format an order, a bound or a plateau for a sentence."""
    if o.kind == "bound":
        return o.text
    if o.verdict == "plateau" and o.plateau == o.plateau:
        return f"plateau at {format_number(o.plateau)}"
    return f"order {o.order:.2f}"


def without_verdict(pairs: list[tuple[Summary, Order]]) -> Iterator[str]:
    """Count the pairs of method and case whose fit has no verdict."""
    undecided = [s for s, o in pairs if o.verdict in OPEN]
    if undecided:
        cases = join_names(dict.fromkeys(s.case for s in undecided), 4)
        yield (
            f"No verdict (undecided or pre-asymptotic): {len(undecided)} of "
            f"{format_count(len(pairs), 'pair')} of a method and a case, on {cases}."
        )
