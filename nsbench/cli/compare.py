"""`nsbench compare`: differences between two folders of results."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace

from nsbench.cli.exit_codes import FINE, NOTHING_COMPARED

EXACT_KINDS = ("class", "max", "min")  # of baseline lines that have no relative tolerance


def command(args: argparse.Namespace, say: Callable[[str], None]) -> int:
    """Say what differs by more than --rtol; 4 if no number is in both folders."""
    from nsbench.gate import baseline
    from nsbench.gate.comparison import compare, format_lines
    from nsbench.gate.facts import facts
    from nsbench.report.data import read
    from nsbench.results.consistency import check

    if not 0 <= args.rtol < 1:
        raise ValueError(f"--rtol is {args.rtol:g}; a number from 0 to 1 is needed")
    check(args.old)
    check(args.new)
    # options of a method may differ between the two: that alone is no difference of numbers
    old, new = (
        {key: replace(fact, config="") for key, fact in facts(read(folder)).items()}
        for folder in (args.old, args.new)
    )
    lines = {key: baseline.line(fact, 0.0, "") for key, fact in old.items()}
    lines = {
        key: line if line.kind in EXACT_KINDS else replace(line, rtol=args.rtol)
        for key, line in lines.items()
    }
    findings = compare(new, lines)
    for text in format_lines(findings):
        say(text)
    compared = any(f.outcome not in ("missing", "new") for f in findings)
    return FINE if compared else NOTHING_COMPARED
