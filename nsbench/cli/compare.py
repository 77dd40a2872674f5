"""`nsbench compare`: differences between folders of results, as lines, Markdown and a page."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from nsbench.cli.exit_codes import FINE, NOTHING_COMPARED

EXACT_KINDS = ("class", "max", "min")  # of baseline lines that have no relative tolerance


def command(args: argparse.Namespace, say: Callable[[str], None]) -> int:
    """Say what differs by more than --rtol; 4 if no number is in both folders.

    Of more than two folders, in the order of their versions, the last is compared with the one
    before; the page shows the history of all.
    """
    from nsbench.gate.compared_numbers import read_versions
    from nsbench.gate.comparison import format_changes, format_lines

    if not 0 <= args.rtol < 1:
        raise ValueError(f"--rtol is {args.rtol:g}; a number from 0 to 1 is needed")
    if args.more and not args.html:
        raise ValueError("more than two folders have a history, which is a page: add --html FILE")
    versions = read_versions([args.old, args.new, *args.more])
    differences = _compare(*versions[-2:], args.rtol)
    for text in format_lines(differences):
        say(text)
    if args.summary:
        heading = f"{versions[-1].name} against {versions[-2].name}"
        with open(args.summary, "a", encoding="utf-8") as file:
            file.write(format_changes(differences, heading))
    if args.html:
        _write_page(versions, differences, args.html)
        say(f"page: {args.html}")
    compared = any(f.outcome not in ("missing", "new") for f in differences)
    return FINE if compared else NOTHING_COMPARED


def _compare(old, new, rtol: float) -> list:
    from nsbench.gate import baseline
    from nsbench.gate.comparison import compare

    lines = {key: baseline.line(fact, 0.0, "") for key, fact in old.facts.items()}
    lines = {
        key: line if line.kind in EXACT_KINDS else replace(line, rtol=rtol)
        for key, line in lines.items()
    }
    return compare(new.facts, lines)


def _write_page(versions, differences, path: str) -> None:
    from nsbench.gate.comparison_page import comparison_section
    from nsbench.report.html_page import render_study_page
    from nsbench.results.atomic_write import write_atomically

    section = comparison_section(versions, differences)
    title = "nsbench compare " + " ".join(v.name for v in versions)
    write_atomically(Path(path), render_study_page(section, title, "Comparison").encode())
