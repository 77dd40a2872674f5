"""docs/columns.md, written from the table of columns.

    python -m nsbench.columns.page > docs/columns.md

A test holds that the page is current.
"""

from __future__ import annotations

from nsbench.columns import table
from nsbench.columns.column import GROUPS, KINDS, Column

HEAD = """# Columns of a result

`runs.parquet` and `runs.csv` hold one row per attempted run. This page is written by
`python -m nsbench.columns.page > docs/columns.md` from the table in `nsbench/columns`; the same
units and meanings are in the schema of `runs.parquet`, in `nsbench list metrics` and in the
glossary of the report. How to read the numbers: [reading_the_numbers.md](reading_the_numbers.md).

Units: s is a second of the clock; 1 is a pure number; state, time, gap, multiplier and impulse
(multiplier x time) are in the units of the case. Errors are absolute; bounds that methods claim
are relative to the largest |x|, at least 1 (`state_scale`). Floor: an error below the value of
that column says nothing. Gate: held by `nsbench gate` near a value (where it is small, max: from
above alone, or min: from below alone), or as the same count. Owner: columns of the bench are
computed by it;
those of the solver are told by the method. A method may count more than is listed here; such a
column has no unit and is the solver's.
"""


def page() -> str:
    """The page as Markdown: a table per group."""
    out = [HEAD]
    kinds = "; ".join(f"{name}: {text}" for name, text in KINDS.items())
    out.append(f"Kinds. {kinds}.\n")
    for group, title in GROUPS.items():
        out += [f"## {title}\n", *_table([c for c in table.COLUMNS if c.group == group])]
    return "\n".join(out)


def _table(columns: list[Column]) -> list[str]:
    head = ["column", "kind", "unit", "meaning", "floor", "gate", "owner"]
    lines = [head, ["---"] * len(head)]
    lines += [
        [f"`{c.name}`", c.kind, c.unit, c.meaning, c.floor and f"`{c.floor}`", c.gate, c.owner]
        for c in columns
    ]
    return [*("| " + " | ".join(v.replace("|", "\\|") for v in x) + " |" for x in lines), ""]


if __name__ == "__main__":
    print(page(), end="")
