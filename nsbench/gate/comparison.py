"""Comparison of the facts of a study with a baseline, and the messages about it.

Every line of the baseline and every fact without one becomes a `Difference` with one of OUTCOMES. A
number passes if |value - new| <= atol + rtol |value| (kind near, count), or if it does not lie
beyond that on one side (max, min); NaN never passes. Messages are lines for a terminal, and a
summary in Markdown for a page of continuous integration.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from nsbench.columns import held_by_gate
from nsbench.gate.baseline import Line
from nsbench.gate.facts import Fact
from nsbench.report.style import escape_markdown, format_count

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
CONFIGURATION = "configuration differs"  # of all numbers of an edited case: one finding a case
FINE = 0
REGRESSED = 1
NOT_COMPARED = 4
# outcomes that are listed one by one
BAD = tuple(o for o in OUTCOMES if o not in ("pass", "not held"))
MAX_FINDINGS_LISTED = 60  # of one outcome; the others are counted
ORDERS = ("state order", "force order")  # neither direction is better
LARGER_IS_BETTER = tuple(c.name for c in held_by_gate() if c.gate == "min")


@dataclass(frozen=True)
class Difference:
    """Outcome of one comparison: one of OUTCOMES, "pass" included, and a sentence with both values.

    key: case, solver, parameters and metric of the number.
    """

    outcome: str
    key: tuple[str, str, str, str]
    sentence: str = ""


def compare(found: dict[tuple, Fact], baseline: dict[tuple, Line]) -> list[Difference]:
    """Compare facts with the lines of a baseline, both by key.

    Returns a difference for every line of the baseline, then one for every fact that has no line.
    """
    out = [_compare_line(found.get(key), line, found) for key, line in baseline.items()]
    return out + [
        Difference("new", key, f"is {format_value(f.value)}; the baseline says nothing of it")
        for key, f in found.items()
        if key not in baseline
    ]


def _compare_line(fact: Fact | None, line: Line, found) -> Difference:
    """Compare one line with its fact (None: `found` has none of that key)."""
    if fact is None:
        near = [f for k, f in found.items() if k[:2] == line.key[:2]]
        why = (
            " and ".join(differing_parts(line.config, near[0].config))
            if near
            else "this method was not run on this case"
        )
        if near:
            why = f"this run{why and f', {why} of another version,'} does not give it any more"
        return Difference("missing", line.key, f"was {format_value(line.value)}; {why}")
    differs = differing_parts(line.config, fact.config)
    if differs:
        return Difference(
            CONFIGURATION,
            line.key,
            f"{' and '.join(differs)} of another version: not comparable",
        )
    if line.kind == "class" or isinstance(fact.value, str):
        if not line.held and isinstance(fact.value, str):
            return Difference(
                "not held", line.key, f"is {fact.value!r}; it changes with the rounding"
            )
        if str(fact.value) == str(line.value):
            return Difference("pass", line.key)
        changed = "status changed" if line.metric in ("status", "statuses") else "regressed"
        return Difference(changed, line.key, f"was {line.value!r}, is {fact.value!r}")
    text = (
        f"was {format_value(line.value)}, is {format_value(fact.value)} (tolerance {line.rtol:g} "
        f"relative, "
        f"{line.atol:g} absolute)"
    )
    allowed = line.atol + line.rtol * abs(line.value)
    if not math.isfinite(fact.value):  # NaN compares false with everything: it must never pass
        return Difference("regressed", line.key, text)
    if not line.held:
        return Difference("not held", line.key, f"{text}: it changes with the rounding")
    over = fact.value - line.value
    if {"max": over <= allowed, "min": -over <= allowed}.get(line.kind, abs(over) <= allowed):
        return Difference("pass", line.key)
    is_better = over > 0 if line.metric in LARGER_IS_BETTER or line.kind == "min" else over < 0
    better = is_better and line.metric not in ORDERS
    return Difference("improved" if better else "regressed", line.key, text)


def differing_parts(a: str, b: str) -> list[str]:
    """Name the parts in which two configurations (`what=digest what=digest`) differ."""
    one, two = (dict(p.partition("=")[::2] for p in c.split()) for c in (a, b))
    return [name for name in dict.fromkeys((*one, *two)) if one.get(name) != two.get(name)]


def describe_changed_cases(found: dict[tuple, Fact], baseline: dict[tuple, Line]) -> list[str]:
    """Say which cases have another digest in the facts than in the baseline, both by key.

    A changed case may give other orders and metrics: its lines are then missing or new.
    """
    old, new = (_case_digests(one.values()) for one in (baseline, found))
    return [
        f"case {case} has changed since the baseline (digest {', '.join(sorted(was))} -> "
        f"{', '.join(sorted(new[case]))}): its lines are not comparable, and some may be missing "
        "or new"
        for case, was in old.items()
        if case in new and new[case] != was
    ]


def _case_digests(entries: Iterable[Fact | Line]) -> dict[str, set[str]]:
    """Return the digests of each case that the configurations of the entries name."""
    out: dict[str, set[str]] = {}
    for entry in entries:
        parts = dict(p.partition("=")[::2] for p in entry.config.split())
        if "case" in parts:
            out.setdefault(entry.case, set()).add(parts["case"])
    return out


def exit_code(differences: list[Difference]) -> int:
    """Choose the exit code: 0 all is as it was; 1 something is not, also when it is better (a stale
    baseline hides the way back); 4 too little could be compared (less is held than is not), or one
    side has what the other lacks."""
    counts = Counter(f.outcome for f in differences)
    if counts.keys() & {"regressed", "status changed", "improved"}:
        return REGRESSED
    held = counts["pass"] > 0 and counts["pass"] >= counts["not held"]
    return FINE if held and counts.keys() <= {"pass", "not held"} else NOT_COMPARED


def format_value(value) -> str:
    """Format a number with six digits, a word with its quotes."""
    return f"{value:.6g}" if isinstance(value, float) else repr(value)


def count_outcomes(differences: list[Difference]) -> str:
    """Say in a sentence how many numbers had which outcome."""
    counts = Counter(f.outcome for f in differences)
    return (
        f"{format_count(len(differences), 'number')}: "
        + ", ".join(f"{counts[o]} {o}" for o in OUTCOMES if counts[o])
        if differences
        else "nothing to compare"
    )


def _findings(differences: list[Difference], outcome: str) -> list[Difference]:
    """Return what is listed of an outcome: of configurations the first number of each case, with
    the count of the others, since an edit of a case concerns all of them alike."""
    some = [f for f in differences if f.outcome == outcome]
    if outcome != CONFIGURATION:
        return some
    by_case: dict[str, list[Difference]] = {}
    for f in some:
        by_case.setdefault(f.key[0], []).append(f)
    return [_with_count(several) for several in by_case.values()]


def _with_count(several: list[Difference]) -> Difference:
    """Return the first of several differences of a case; its sentence counts the others."""
    first, *others = several
    if not others:
        return first
    verb = "is" if len(others) == 1 else "are"
    more = f"nor {verb} {format_count(len(others), 'more number')} of {first.key[0]}"
    return Difference(first.outcome, first.key, f"{first.sentence}; {more}")


def format_lines(differences: list[Difference]) -> list[str]:
    """Format for a terminal what is not as before, outcome by outcome, and the counts."""
    out = []
    for outcome in BAD:
        some = _findings(differences, outcome)
        out += [f"{outcome}: {' '.join(f.key)}: {f.sentence}" for f in some[:MAX_FINDINGS_LISTED]]
        if len(some) > MAX_FINDINGS_LISTED:
            out.append(f"{outcome}: and {len(some) - MAX_FINDINGS_LISTED} more")
    return [*out, count_outcomes(differences)]


def format_summary(
    differences: list[Difference], code: int, changed_cases: Sequence[str] = ()
) -> str:
    """Format in Markdown the verdict, the changed cases, and a table of what is not as before.

    code: `exit_code`; changed_cases: `describe_changed_cases`.
    """
    verdict = {
        0: "All numbers are as in the baseline.",
        1: "Some numbers are not as in the baseline.",
        4: "Too little could be compared with the baseline.",
    }[code]
    return format_changes(differences, verdict, changed_cases)


def format_changes(
    differences: list[Difference], heading: str, causes: Sequence[str] = ()
) -> str:
    """Format in Markdown a heading, causes, the counts, and a table of what is not as before."""
    out = [f"### {escape_markdown(heading)}", ""]
    for cause in causes:
        out += [f"{escape_markdown(cause)}.", ""]
    out += [count_outcomes(differences) + ".", ""]
    bad = [f for outcome in BAD for f in _findings(differences, outcome)]
    if bad:
        out += ["| | case | method | at | number | |", "| --- | --- | --- | --- | --- | --- |"]
        out += [
            "| " + " | ".join(escape_markdown(v) for v in (f.outcome, *f.key, f.sentence)) + " |"
            for f in bad[:MAX_FINDINGS_LISTED]
        ]
        if len(bad) > MAX_FINDINGS_LISTED:
            out += ["", f"… and {len(bad) - MAX_FINDINGS_LISTED} more."]
    return "\n".join(out) + "\n"
