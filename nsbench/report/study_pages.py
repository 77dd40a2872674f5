"""The section on studies: DIR/studies/*.json read, checked and laid out.

The files may have been written by others: texts are sanitised, numbers checked, figures embedded as
images, and a file that is no finding is a ValueError that names it.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from nsbench.report.style import format_count, format_number, sanitise
from nsbench.report.tables.cells import Cell, Row, Table
from nsbench.report.verdict import FAILED, MULTIPLIERS, Statement
from nsbench.source_files.regular_files import UnusableFile, exists, read_text

FOLDER = "studies"  # of a folder of results
MAX_BYTES = 16 << 20  # of a finding
MAX_FIGURE_BYTES = 1 << 20
MAX_ROWS = 2000  # of a table on the page
DIGITS = 4  # of numbers in tables
ONE_LINE = 32  # characters of a cell that is not broken: an order with its interval, a name
TEXTS = ("study", "question", "answer", "refutation", "command", "form")


@dataclass(frozen=True)
class StudyFigure:
    """A figure: caption, SVG text, and its file below the folder of results."""

    caption: str
    svg: str
    file: str


@dataclass(frozen=True)
class StudySection:
    """One study as the report shows it; short: the answer in a sentence. note: form and time."""

    name: str
    question: str
    short: str
    answer: str
    evidence: tuple[str, ...]
    refutation: str
    command: str
    note: str
    tables: tuple[tuple[str, Table], ...]
    figures: tuple[StudyFigure, ...]


def read_studies(folder: Path) -> tuple[StudySection, ...]:
    """Read all findings of a folder of results, by name; () where there are none.

    Raises ValueError, naming the file, for one that cannot be used.
    """
    place = folder / FOLDER
    return tuple(read_study(p) for p in sorted(place.glob("*.json")))


def read_study(path: Path) -> StudySection:
    """Read one finding. Raises ValueError, naming the file, and FileNotFoundError."""
    try:
        stored = json.loads(read_text(path, MAX_BYTES, path.parent))
        text = {name: _text(stored[name]) for name in TEXTS}
        short = _text(stored.get("short", ""))  # findings of 0.1.0 have none
        tables = [(_text(t["title"]), _table(text["study"], t)) for t in stored["tables"]]
        figures = [_figure(path.parent, f) for f in stored["figures"]]
        evidence = tuple(map(_text, stored["evidence"]))
        seconds = format_number(float(stored["seconds"]), 3)
    except UnusableFile:
        raise
    except (ValueError, KeyError, TypeError, RecursionError) as e:
        raise UnusableFile(f"{path} is no finding of a study: {type(e).__name__}: {e}") from e
    return StudySection(
        name=text["study"],
        question=text["question"],
        short=short,
        answer=text["answer"],
        evidence=evidence,
        refutation=text["refutation"],
        command=text["command"],
        note=f"The {text['form']} form took {seconds} s.",
        tables=tuple(tables),
        figures=tuple(f for f in figures if f is not None),
    )


def _text(value: object) -> str:
    """Sanitise a text; raises TypeError for anything else."""
    if not isinstance(value, str):
        raise TypeError(f"{value!r} is no text")
    return sanitise(value, 2000)


def _table(study: str, stored: dict) -> Table:
    columns = tuple(map(_text, stored["columns"]))
    rows = stored["rows"][:MAX_ROWS]
    if any(len(row) != len(columns) for row in rows):
        raise ValueError(f"a row of {stored['key']!r} has not {len(columns)} values")
    return Table(
        f"{_text(study)}-{_text(stored['key'])}",
        columns,
        tuple(Row(tuple(map(_cell, row))) for row in rows),
        _text(stored["note"]),
    )


def _cell(value: object) -> Cell:
    """Format a word or number; a dash stands for nothing."""
    if value is None:
        return Cell("–", kind="quiet")
    if isinstance(value, str):
        return Cell(sanitise(value, 200), kind="short" * (len(value) <= ONE_LINE))
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise TypeError(f"{value!r} is neither a word nor a number")
    whole = isinstance(value, int)
    return Cell(str(value) if whole else format_number(value, DIGITS), kind="number")


def _figure(folder: Path, stored: dict) -> StudyFigure | None:
    """Read a figure; None where its file is not there."""
    name = Path(_text(stored["file"])).name
    if not exists(folder / name):
        return None
    svg = read_text(folder / name, MAX_FIGURE_BYTES, folder)
    return StudyFigure(_text(stored["caption"]), svg, f"{FOLDER}/{name}")


def cite_studies(
    statements: Iterable[Statement], studies: tuple[StudySection, ...], with_pbd: bool
) -> tuple[Statement, ...]:
    """Add what studies found to the statements on multipliers and on failures.

    with_pbd: PBD gave numbers on contacts.
    """
    added = {
        MULTIPLIERS: [_say_settling(studies)] if with_pbd else [],
        FAILED: [
            *(_say_failures(s, t) for s in studies for t in failures_of(s)),
            *_say_large_steps(studies, with_pbd),
        ],
    }
    return tuple(replace(s, sentences=(*s.sentences, *added.get(s.head, ()))) for s in statements)


def _say_settling(studies: tuple[StudySection, ...]) -> str:
    """Say how many steps of PBD multipliers need, with the numbers of the study that has them."""
    found = next((s.short for s in studies if s.name == "multipliers" and s.short), "")
    tail = found or "this report holds no number of its own; `nsbench study multipliers` finds it."
    return (
        "PBD passes a load on like heat: in a column of n discs the multipliers are right only "
        f"after a number of steps that grows like n^2 (study `multipliers`): {tail}"
    )


def _say_large_steps(studies: tuple[StudySection, ...], with_pbd: bool) -> list[str]:
    """Say where to find how methods behave at steps far above those of a ladder."""
    if not with_pbd or any(s.name == "stability" for s in studies):
        return []
    return [
        "Ladders begin at steps that are asymptotic: how PBD and the other methods behave at much "
        "larger ones is asked by `nsbench study stability` (stacks, piles, 10^5 steps)."
    ]


def failures_of(study: StudySection) -> list[Table]:
    """Return the tables of a study that list what did not end well: status and sentence a line."""
    needed = {"method", "status", "sentence"}
    return [t for _, t in study.tables if needed <= set(t.columns) and t.rows]


def _say_failures(study: StudySection, t: Table) -> str:
    at = t.columns.index("status")
    counted = Counter(row.cells[at].text for row in t.rows).most_common()
    words = ", ".join(f"{count} {status}" for status, count in counted)
    return (
        f"In the study `{study.name}` {format_count(len(t.rows), 'cell')} did not end well "
        f"({words}): their sentences stand under the failures of this report."
    )


def write_study_page(folder: Path, name: str) -> Path:
    """Write DIR/studies/NAME.html, the page of one study, and return its path."""
    from nsbench.report.html_page import render_study_page
    from nsbench.results.atomic_write import write_atomically

    section = read_study(folder / FOLDER / f"{name}.json")
    path = folder / FOLDER / f"{name}.html"
    write_atomically(path, render_study_page(section).encode())
    return path
