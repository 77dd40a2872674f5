"""Record that describes one column of a result: name, unit, meaning, and who uses it how."""

from __future__ import annotations

from dataclasses import dataclass

KINDS = {
    "number": "floating-point number; missing: NaN",
    "count": "whole number, stored as a number",
    "flag": "true or false; the report reads it as 1 and 0",
    "word": "text; missing: empty",
}
GROUPS = {  # in the order of docs/columns.md
    "run": "What was run",
    "ending": "How it ended",
    "work": "Counted work and settings, told by the method",
    "error": "Errors against the reference",
    "error bar": "Error bars, which need no reference",
    "selection": "Multipliers that are not unique",
    "floor": "Floors and scales of the errors",
    "reference": "What the errors are measured against",
    "residual": "Residuals, which need no reference",
    "clock": "Seconds",
}
# What the numbers of errors mean, in the words of all sentences: columns of errors are absolute,
# claimed bounds are of an error divided by the column of its scale (state_scale, impulse_scale).
ABSOLUTE = "absolute, in the units of the case"
RELATIVE = "relative to the largest |x|, at least 1"
OWNERS = ("bench", "solver")
GATES = ("", "near", "max", "min", "count")


@dataclass(frozen=True)
class Column:
    """One column of a result.

    name: in runs.csv, runs.parquet and the rows of a study. group: one of GROUPS. kind: one of
    KINDS. unit: "s" for seconds of the clock, "1" for a pure number, "" for words; the rest are in
    the units of the case (state, time, impulse = multiplier x time, gap). meaning: a phrase without
    a full stop. label: how the report names the quantity ("": by `name`).

    gate: how `nsbench gate` holds it: "near" a value (from above alone below its floor), "max" from
    above, "min" as well but from below alone where it is small, "count" as the same number, "" not
    at all. floor: the column below whose value this error
    says nothing ("": none). scale: the column with the size that rounding is relative to ("": 1).
    owner: who may write it; an entry of a method's stats that bears the name of a "bench" column is
    left out. ValueError for a kind, group, gate or owner that does not exist.
    """

    name: str
    group: str
    kind: str
    unit: str
    meaning: str
    label: str = ""
    gate: str = ""
    floor: str = ""
    scale: str = ""
    owner: str = "bench"

    def __post_init__(self):
        for field, known in (
            ("group", GROUPS),
            ("kind", KINDS),
            ("gate", GATES),
            ("owner", OWNERS),
        ):
            if getattr(self, field) not in known:
                raise ValueError(
                    f"column {self.name}: {field} is {getattr(self, field)!r}; one of "
                    f"{', '.join(map(repr, known))} is needed"
                )

    @property
    def is_number(self) -> bool:
        """Is it held as float64 by the report? Counts and flags are, words are not."""
        return self.kind != "word"

    @property
    def title(self) -> str:
        """Heading in a table of the report."""
        return self.label or self.name
