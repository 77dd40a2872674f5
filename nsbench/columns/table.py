"""The one table of all columns of a result, and questions to it.

Whoever writes, stores, prints or holds a column asks here: `nsbench.measure.errors` (which errors
there are), `nsbench.study` (which names a method may not use), `nsbench.results.tables` (unit and
meaning in the schema of runs.parquet), `nsbench.report` (what is a number, labels, floors, the
glossary), `nsbench.gate` (what is held, and how), `nsbench list metrics` and docs/columns.md.

A new column is one entry in a file of this folder (measured_columns, residual_columns,
run_columns) and its value, under the same name: an error in `nsbench.measure.errors`, a residual
in `found` of `nsbench.measure.residuals`, counted work in the `stats` of a trajectory. A new tuple
of entries is named in COLUMNS below. `python -m nsbench.columns.page` writes docs/columns.md anew.

The table lies below `measure` and `study`, which need it, and not in `results`, which is above
them. It is a part of what every row is made of (nsbench.results.run_key): rows are made again
after an edit, so that a column that was added is in all of them.

A method may count whatever it likes in the `stats` of its trajectory. An entry that is not in the
table is a column as well, without a unit and owned by the solver (`describe`).
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from types import MappingProxyType

from nsbench.columns.column import Column
from nsbench.columns.measured_columns import (
    ERROR_BARS,
    ERRORS,
    FLOORS,
    REFERENCE,
    SELECTION,
)
from nsbench.columns.residual_columns import RESIDUALS
from nsbench.columns.run_columns import CLOCK, ENDING, RUN, WORK

COLUMNS: tuple[Column, ...] = (
    *RUN,
    *ENDING,
    *WORK,
    *ERRORS,
    *ERROR_BARS,
    *SELECTION,
    *FLOORS,
    *REFERENCE,
    *RESIDUALS,
    *CLOCK,
)
# NaN in a row until `measure.errors` knows them
MEASURED_GROUPS = ("error", "error bar", "selection", "floor")
# entries that a worker hangs on a row for its parent, which takes them off again: no columns
TRANSPORT = ("read", "unlike")
UNKNOWN = "counted by the method, which alone knows its meaning"


@functools.cache
def by_name() -> Mapping[str, Column]:
    """The columns of the table by their names, in its order."""
    return MappingProxyType({c.name: c for c in COLUMNS})


def names(*groups: str) -> tuple[str, ...]:
    """Names of the columns of these groups (none: of all), in the order of the table."""
    return tuple(c.name for c in COLUMNS if not groups or c.group in groups)


def describe(name: str, kind: str = "number") -> Column:
    """The column of this name; for one that is not in the table an entry without a unit, of this
    kind, owned by the solver."""
    found = by_name().get(name)
    return found or Column(name, "work", kind, "", UNKNOWN, owner="solver")


def reserved_names() -> frozenset[str]:
    """Names that a method's stats may not use: columns of the bench, and TRANSPORT."""
    return frozenset((*(c.name for c in COLUMNS if c.owner == "bench"), *TRANSPORT))


def held_by_gate() -> tuple[Column, ...]:
    """Columns that the gate holds: near a value or from above first, then counts."""
    held = [c for c in COLUMNS if c.gate]
    return tuple(sorted(held, key=lambda c: c.gate == "count"))
