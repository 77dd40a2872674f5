"""Tables of the study `stability`: maps of status and error, cells that failed, held stacks."""

from __future__ import annotations

from nsbench.report.style import format_number
from nsbench.studies.finding import EvidenceTable
from nsbench.studies.stability.maps import DIVISORS, OWN, Map


def is_sound(cell: dict) -> bool:
    """Is the status of a cell one of runs that ended well?"""
    return cell["status"] in ("ok", "below_reference", "degenerate")


def map_table(m: Map, rows: dict[float, list[dict]]) -> EvidenceTable:
    """Build the table of a map: a line for each difficulty and method, a column for each step."""
    columns = [*(f"/{n}" for n in DIVISORS), OWN]
    out = []
    for value, cells in rows.items():
        for method in dict.fromkeys(c["method"] for c in cells):
            own = {c["column"]: c for c in cells if c["method"] == method}
            out.append((value, method, *(show(own.get(c)) for c in columns)))
    return EvidenceTable(
        f"map-{m.name}",
        f"State error over step and {m.difficulty}",
        (
            m.difficulty,
            "method",
            *(f"h = spacing / {n}" for n in DIVISORS),
            "own accuracy",
        ),
        tuple(out),
        f"Scenes: {m.template}. A number is the largest state error of a run that ended well; a "
        "word is the status of a run that did not, with its error in brackets where it reached "
        "the end. Own accuracy: methods without a step, at their default.",
    )


def show(cell: dict | None) -> str | float | None:
    """Return the error of a cell, or its status with the error in brackets; None for no cell."""
    if cell is None:
        return None
    if is_sound(cell) and cell["error"] is not None:
        return cell["error"]
    error = "" if cell["error"] is None else f" ({format_number(cell['error'], 2)})"
    return f"{cell['status']}{error}"


def failures_table(cells) -> EvidenceTable:
    """Build the table of the cells that did not end well, with their sentences."""
    rows = [
        (m.name, float(value), c["method"], c["h"], c["status"], c["sentence"][:200])
        for m, value, c in cells
        if not is_sound(c)
    ]
    return EvidenceTable(
        "failures",
        "Cells that did not end well",
        ("map", "difficulty", "method", "h", "status", "sentence"),
        tuple(rows),
        "One line for each.",
    )


def holds_table(key: str, title: str, holds: list[dict]) -> EvidenceTable:
    """Build the table of columns or piles that were held for many steps."""
    fields = ("n", "steps", "h", "method", "status")
    values = ("sunk", "drift", "jitter", "energy", "rise", "sideways", "toppled")
    words = {"drift": "drift per unit time", "rise": "energy rise"}
    return EvidenceTable(
        key,
        title,
        (*fields, *(words.get(v, v) for v in values)),
        tuple((*(h[f] for f in fields), *(h.get(v) for v in values)) for h in holds),
        "Lengths in radii, unit weights and gravity; methods without a step have their default "
        "accuracy. Sunk: largest displacement; drift: of the "
        "mean height in the second half; jitter: largest displacement in one of the last steps; "
        "energy: change of the potential energy; rise: its largest increase between samples; "
        "toppled: discs that moved by more than a radius against one that they touched at the "
        "start. With 0 steps a method is not run, for its cost.",
    )
