"""Columns of a result: name, unit, meaning, floor and owner of each, in one table."""

from nsbench.columns.column import ABSOLUTE, GROUPS, KINDS, RELATIVE, Column
from nsbench.columns.table import (
    MEASURED_GROUPS,
    by_name,
    describe,
    held_by_gate,
    names,
    reserved_names,
)

__all__ = [
    "ABSOLUTE",
    "GROUPS",
    "KINDS",
    "MEASURED_GROUPS",
    "RELATIVE",
    "Column",
    "by_name",
    "describe",
    "held_by_gate",
    "names",
    "reserved_names",
]
