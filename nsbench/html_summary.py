"""Short tables in HTML, as notebooks show an object: `_repr_html_` of cases, runs and fits."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape


def summary_table(title: str, lines: Iterable[tuple[str, object]]) -> str:
    """Return a title and lines (name, value) as an HTML table; all text is escaped."""
    cells = "".join(
        f"<tr><th style='text-align:left'>{escape(name)}</th>"
        f"<td style='text-align:left'>{escape(str(value))}</td></tr>"
        for name, value in lines
    )
    return f"<table><caption><b>{escape(title)}</b></caption>{cells}</table>"


def rows_table(title: str, head: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a title, a head and rows of cells as an HTML table; all text is escaped."""
    top = "".join(f"<th>{escape(name)}</th>" for name in head)
    body = "".join(
        f"<tr>{''.join(f'<td>{escape(str(cell))}</td>' for cell in row)}</tr>" for row in rows
    )
    return f"<table><caption><b>{escape(title)}</b></caption><tr>{top}</tr>{body}</table>"
