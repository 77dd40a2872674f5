"""What the gate says: lines for a terminal, and a summary in Markdown for a page of continuous
integration."""

from __future__ import annotations

from collections import Counter

from nsbench.gate.comparison import OUTCOMES, Finding
from nsbench.report.style import escape_markdown, format_count

MOST = 60  # findings of one kind that are listed; the others are counted
BAD = tuple(o for o in OUTCOMES if o not in ("pass", "not held"))


def sentence(findings: list[Finding]) -> str:
    """How many numbers ended how."""
    seen = Counter(f.outcome for f in findings)
    return (
        f"{format_count(len(findings), 'number')}: "
        + ", ".join(f"{seen[o]} {o}" for o in OUTCOMES if seen[o])
        if findings
        else "nothing to compare"
    )


def lines(findings: list[Finding]) -> list[str]:
    """What is not as before, kind by kind, and the sum."""
    out = []
    for outcome in BAD:
        some = [f for f in findings if f.outcome == outcome]
        out += [f"{outcome}: {' '.join(f.key)}: {f.sentence}" for f in some[:MOST]]
        if len(some) > MOST:
            out.append(f"{outcome}: and {len(some) - MOST} more")
    return [*out, sentence(findings)]


def summary(findings: list[Finding], code: int) -> str:
    """Markdown: the verdict, then a table of what is not as before."""
    verdict = {
        0: "All numbers are as in the baseline.",
        1: "Some numbers are not as in the baseline.",
        4: "Too little could be compared with the baseline.",
    }[code]
    out = [f"### {verdict}", "", sentence(findings) + ".", ""]
    bad = [f for outcome in BAD for f in findings if f.outcome == outcome]
    if bad:
        out += ["| | case | method | at | number | |", "| --- | --- | --- | --- | --- | --- |"]
        out += [
            "| " + " | ".join(escape_markdown(v) for v in (f.outcome, *f.key, f.sentence)) + " |"
            for f in bad[:MOST]
        ]
        if len(bad) > MOST:
            out += ["", f"… and {len(bad) - MOST} more."]
    return "\n".join(out) + "\n"
