"""What a study returns and how it is stored: DIR/studies/NAME.json and one SVG per figure.

The JSON file holds the fields of `Finding`, the tables as lists of rows, the figures by file name,
and the study's own data (`graphs` of the study `lemma`) at its top level. The report reads these
files; it computes nothing itself.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from nsbench.results.atomic_write import write_atomically
from nsbench.studies.part_journal import PartJournal
from nsbench.studies.parts import Part, Workers, compute_elsewhere, compute_here

FOLDER = "studies"  # of a folder of results
SCHEMA = 1
Value = str | float | int | None


@dataclass(frozen=True)
class EvidenceTable:
    """A table of evidence: rows of words and numbers (None: nothing to report), and a note."""

    key: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Value, ...], ...]
    note: str = ""


@dataclass(frozen=True)
class EvidenceFigure:
    """A figure as standalone SVG text with its caption; key: part of its file name."""

    key: str
    caption: str
    svg: str = field(repr=False)


@dataclass(frozen=True)
class Finding:
    """The outcome of a study.

    short: the answer in one short sentence, a yes, a no or a number. answer: the same at length.
    Both are made from the numbers. evidence: further sentences. refutation: what would refute the
    answer. command: repeats the study. data: fields of the study's own, for programs.
    """

    name: str
    question: str
    short: str
    answer: str
    evidence: tuple[str, ...]
    refutation: str
    command: str
    tables: tuple[EvidenceTable, ...]
    figures: tuple[EvidenceFigure, ...]
    data: dict


@dataclass(frozen=True)
class Effort:
    """How much a study may do.

    full: the complete form; else the small one, of a minute at most. journal: stores finished
    parts, so that an interrupted study goes on. report: called with a line of progress. workers:
    compute `parts` (None: this process does).
    """

    full: bool
    journal: PartJournal
    report: Callable[[str], None]
    workers: Workers | None = None

    def choose(self, small: int, full: int) -> int:
        """Return the size of the form that was asked for."""
        return full if self.full else small

    def parts(self, parts: Sequence[Part]) -> list:
        """Return the values of parts that need no other one, in order.

        Several are computed at a time where there are workers: what measures seconds is none of
        them, but a part of the journal.
        """
        if self.workers is None:
            return compute_here(parts, self.journal, self.report)
        return compute_elsewhere(parts, self.journal, self.report, self.workers)


def write_finding(finding: Finding, folder: Path, seconds: float, full: bool) -> Path:
    """Write the finding below DIR/studies and return the path of its JSON file.

    seconds: the time that the study took. Raises StoreError where that fails.
    """
    place = folder / FOLDER
    place.mkdir(parents=True, exist_ok=True)
    files = {f.key: f"{finding.name}_{f.key}.svg" for f in finding.figures}
    for figure in finding.figures:
        write_atomically(place / files[figure.key], figure.svg.encode())
    document = {
        "schema": SCHEMA,
        "study": finding.name,
        "form": "full" if full else "small",
        "question": finding.question,
        "short": finding.short,
        "answer": finding.answer,
        "evidence": list(finding.evidence),
        "refutation": finding.refutation,
        "command": finding.command,
        "seconds": round(seconds, 1),
        "tables": [
            {"key": t.key, "title": t.title, "columns": t.columns, "rows": t.rows, "note": t.note}
            for t in finding.tables
        ],
        "figures": [
            {"key": f.key, "caption": f.caption, "file": files[f.key]} for f in finding.figures
        ],
        **finding.data,
    }
    path = place / f"{finding.name}.json"
    text = json.dumps(_without_infinities(document), indent=1, allow_nan=False)
    write_atomically(path, f"{text}\n".encode())
    return path


def _without_infinities(value: object) -> object:
    """Replace numbers that JSON cannot hold by None, at any depth."""
    if isinstance(value, dict):
        return {k: _without_infinities(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_without_infinities(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
