"""A table of the report as plain data: cells, rows, columns.

nsbench.report.html_page writes tables as HTML, nsbench.report.markdown as Markdown.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Cell:
    """One cell of a table.

    small: a second, quieter line. title: the sentence behind it. kind: a word that sets the tone
    (number, short, flag, bad, refused, failed, quiet, best, method). span: columns taken.
    """

    text: str
    small: str = ""
    title: str = ""
    kind: str = ""
    span: int = 1


@dataclass(frozen=True)
class Row:
    """One line of a table.

    group: the case it belongs to, shown once as a heading. solver, kind: for filters. anchor: the
    case or method whose row this is, to which links lead; "": none.
    """

    cells: tuple[Cell, ...]
    group: str = ""
    solver: str = ""
    kind: str = ""
    anchor: str = ""


@dataclass(frozen=True)
class Table:
    """A table with its note below; key: its id within the page."""

    key: str
    columns: tuple[str, ...]
    rows: tuple[Row, ...]
    note: str = ""
