"""Ratio of a baseline's tolerances to claimed errors: how large an error may pass the gate.

A line whose tolerance is many times the claim of its method holds nothing, however many numbers
pass. Where a method claims no bound, what it showed, or the floor of that number, is its claim.
"""

from __future__ import annotations

from dataclasses import dataclass

from nsbench.gate.baseline import MOST, Line, is_blind, times_claim
from nsbench.gate.facts import Fact
from nsbench.report.style import format_count


@dataclass(frozen=True)
class Widest:
    """The line of one method with the largest tolerance over the claim.

    times: how many times the claim it lets pass; lines: numbers of the method that are held; blind:
    so many of them let more than ten times the claim pass.
    """

    solver: str
    line: Line
    times: float
    lines: int
    blind: int


def widest_by_method(found: dict[tuple, Fact], lines: dict[tuple, Line]) -> list[Widest]:
    """Find the widest line of every method, the most tolerant method first.

    found: facts, lines: of a baseline, both by key. Lines of another configuration than that of
    their fact, and lines that hold no number, are left out.
    """
    groups: dict[str, list[tuple[float, Line, bool]]] = {}
    for key, line in lines.items():
        fact = found.get(key)
        if fact is None or fact.config != line.config or not line.held:
            continue
        if line.kind in ("near", "max", "min"):
            groups.setdefault(line.solver, []).append(
                (times_claim(line, fact), line, is_blind(line, fact))
            )
    out = []
    for solver, group in groups.items():
        times, line, _ = max(group, key=lambda entry: entry[0])
        blind = sum(entry[2] for entry in group)
        out.append(Widest(solver, line, times, len(group), blind))
    return sorted(out, key=lambda w: -w.times)


def format_tolerances(widest: list[Widest]) -> list[str]:
    """Say in a sentence per method what its widest line lets pass, and how many let too much."""
    return [
        f"{w.solver}: of {format_count(w.lines, 'number')} the widest lets {w.times:.2g} times the "
        f"claim pass: {' '.join(w.line.key)}"
        + (f"; {w.blind} let more than {MOST:g} times pass" if w.blind else "")
        for w in widest
    ]


def why_not_held(fact: Fact, line: Line, spread: float) -> str:
    """Say why a fact of that spread has a line that is not held; "" if it is held."""
    if line.held:
        return ""
    name = " ".join(fact.key)
    if fact.kind in ("max", "min"):
        claim = fact.claim or max(abs(fact.value), fact.floor)
        return (
            f"{name}: is {fact.value:.2g} and spreads by {spread:.2g}; ten times that lets more "
            f"than {MOST:g} times {claim:.2g} pass, the claim of the method or the floor of the "
            "number"
        )
    return f"{name}: spreads by {spread:.2g}"
