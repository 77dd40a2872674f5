"""Tabulate which publications describe the methods of a study, and collect their BibTeX entries.

The entries are in nsbench/report/citations.bib; this module says which method needs which.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable
from pathlib import Path

from nsbench.report.style import method_of
from nsbench.report.tables.cells import Cell, Row, Table

FILE = Path(__file__).parents[1] / "citations.bib"
SOURCES = {  # what describes a method
    "pbd": ("mueller2007", "pbd"),
    "pbd_jax": ("mueller2007", "pbd"),
    "richardson": ("richardson1911", "hairer1993"),
    "catching_up": ("maury2011", "bernicot2013"),
    "event_driven": ("filippov1988", "jorba2005", "hairer1993"),
    "penalty": ("kidger2021",),
    "theta": ("han2009", "acary2008"),
    "euler": ("acary2008",),
    "solve_ivp": ("hairer1993",),
    "kdtree": ("mueller2007", "pbd", "bentley1975"),
    "nosnoc": ("fesd", "nosnoc"),
}
LIBRARIES = {  # what a method runs on
    **dict.fromkeys(("pbd", "richardson", "catching_up", "theta", "euler"), ("numba",)),
    **dict.fromkeys(("pbd_jax", "penalty"), ("jax",)),
    **dict.fromkeys(("event_driven", "kdtree"), ("scipy", "numba")),
    "solve_ivp": ("scipy",),
    "nosnoc": ("ipopt", "casadi"),
}
# of the options of a method, in order: the first one that its name holds counts, "" always
BY_OPTION = {
    "catching_up": (
        ("backend=osqp", ("osqp",)),
        ("backend=piqp", ("piqp",)),
        ("", ("goldfarb1983",)),
    ),
    "richardson": (("method=catching_up", ("maury2011",)), ("", ("pbd",))),
}
UNKNOWN = "none known to the report: cite what its author names"


@functools.cache
def read_entries() -> dict[str, str]:
    """Return the BibTeX entries of this package by key."""
    text = FILE.read_text(encoding="utf-8").strip()
    entries = re.split(r"\n(?=@)", text)
    return {re.match(r"@\w+\{(\w+),", e)[1]: e for e in entries}


def sources_of(spec: str) -> tuple[str, ...]:
    """Return the keys of the entries of a method with its options; () where none is known."""
    name = method_of(spec)
    by_option = next((keys for word, keys in BY_OPTION.get(name, ()) if word in spec), ())
    return (*SOURCES.get(name, ()), *by_option, *LIBRARIES.get(name, ()))


def describe_entry(key: str) -> str:
    """Name an entry by its authors and its year: ``Maury & Venel 2011 (maury2011)``."""
    entry = read_entries()[key]
    year = re.search(r"year\s*= \{(\d+)\}", entry)[1]
    authors = re.search(r"author\s*= \{(.*?)\},\n", entry, re.DOTALL)[1]
    names = [_plain(a.partition(",")[0]) for a in re.split(r"\s+and\s+", authors)]
    few = " & ".join(names) if len(names) <= 2 else f"{names[0]} et al."
    return f"{few} {year} ({key})"


def _plain(name: str) -> str:
    """Write a name with its LaTeX accents as plain letters."""
    accents = {r'{\"u}': "ü", r'{\"a}': "ä", r"{\'c}": "ć"}
    for latex, letter in accents.items():
        name = name.replace(latex, letter)
    return name


def citation_table(specs: Iterable[str]) -> Table:
    """Build the table of methods and the entries that describe them."""
    rows = [
        Row(
            (
                Cell(spec, kind="method"),
                Cell("; ".join(map(describe_entry, sources_of(spec))) or UNKNOWN),
            ),
            solver=spec,
            anchor=spec,
        )
        for spec in specs
    ]
    return Table(
        "citations",
        ("method", "sources"),
        tuple(rows),
        "First what describes the method, then the libraries it runs on, whose versions are below; "
        "in brackets the keys of the BibTeX entries above.",
    )


def bibtex_of(specs: Iterable[str]) -> str:
    """Return the entries of these methods, each once; first PBD, out of which the bench grew."""
    keys = dict.fromkeys(["pbd", *(key for spec in specs for key in sources_of(spec))])
    return "\n".join(read_entries()[key] for key in keys)
