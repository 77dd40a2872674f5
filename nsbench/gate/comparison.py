"""Facts against a baseline: what is as before, what is not, and how."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

from nsbench.gate.baseline import Line
from nsbench.gate.facts import Fact

OUTCOMES = (
    "pass",
    "not held",
    "regressed",
    "improved",
    "status changed",
    "configuration differs",
    "missing",
    "new",
)
FINE = 0
REGRESSED = 1
NOT_COMPARED = 4
ORDERS = ("state order", "force order")  # neither direction is better


@dataclass(frozen=True)
class Finding:
    """One line of the comparison: outcome (one of OUTCOMES) and a sentence with both values."""

    outcome: str
    key: tuple[str, str, str, str]
    sentence: str = ""


def compare(found: dict[tuple, Fact], baseline: dict[tuple, Line]) -> list[Finding]:
    """A finding for every line of the baseline, then one for every fact that has none."""
    out = [_one(found.get(key), line, found) for key, line in baseline.items()]
    return out + [
        Finding("new", key, f"is {format_value(f.value)}; the baseline says nothing of it")
        for key, f in found.items()
        if key not in baseline
    ]


def _one(fact: Fact | None, line: Line, found) -> Finding:
    if fact is None:
        near = [f for k, f in found.items() if k[:2] == line.key[:2]]
        why = (
            "this method was not run on this case"
            if not near
            else "this run does not give it any more"
        )
        return Finding("missing", line.key, f"was {format_value(line.value)}; {why}")
    differs = differing_parts(line.config, fact.config)
    if differs:
        return Finding(
            "configuration differs",
            line.key,
            f"{' and '.join(differs)} of another version: not comparable",
        )
    if line.kind == "class" or isinstance(fact.value, str):
        if not line.held and isinstance(fact.value, str):
            return Finding("not held", line.key, f"is {fact.value!r}; it changes with the rounding")
        if str(fact.value) == str(line.value):
            return Finding("pass", line.key)
        changed = "status changed" if line.metric in ("status", "statuses") else "regressed"
        return Finding(changed, line.key, f"was {line.value!r}, is {fact.value!r}")
    text = (
        f"was {format_value(line.value)}, is {format_value(fact.value)} (tolerance {line.rtol:g} "
        f"relative, "
        f"{line.atol:g} absolute)"
    )
    room = line.atol + line.rtol * abs(line.value)
    if not math.isfinite(fact.value):  # NaN compares false with everything: it must never pass
        return Finding("regressed", line.key, text)
    if not line.held:
        return Finding("not held", line.key, f"{text}: it changes with the rounding")
    over = fact.value - line.value
    if {"max": over <= room, "min": -over <= room}.get(line.kind, abs(over) <= room):
        return Finding("pass", line.key)
    better = over < 0 and line.kind != "min" and line.metric not in ORDERS
    return Finding("improved" if better else "regressed", line.key, text)


def differing_parts(a: str, b: str) -> list[str]:
    """Names of the parts in which two configurations differ."""
    one, two = (dict(p.partition("=")[::2] for p in c.split()) for c in (a, b))
    return [name for name in dict.fromkeys((*one, *two)) if one.get(name) != two.get(name)]


def exit_code(findings: list[Finding]) -> int:
    """1: something is not as it was (also when it is better: a stale baseline hides the way back);
    4: too little could be compared (less is held than is not), or one side has what the other
    lacks; 0: all is as it was."""
    seen = Counter(f.outcome for f in findings)
    if seen.keys() & {"regressed", "status changed", "improved"}:
        return REGRESSED
    held = seen["pass"] > 0 and seen["pass"] >= seen["not held"]
    return FINE if held and seen.keys() <= {"pass", "not held"} else NOT_COMPARED


def format_value(value) -> str:
    return f"{value:.6g}" if isinstance(value, float) else repr(value)
