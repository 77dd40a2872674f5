"""Columns of a result: name, unit, meaning, floor and owner of each, in one table."""

from nsbench.columns.column import GROUPS, KINDS, Column
from nsbench.columns.table import (
    MEASURED_GROUPS,
    by_name,
    describe,
    held_by_gate,
    names,
    reserved_names,
)

__all__ = [
    "GROUPS",
    "KINDS",
    "MEASURED_GROUPS",
    "Column",
    "by_name",
    "describe",
    "held_by_gate",
    "names",
    "reserved_names",
]
