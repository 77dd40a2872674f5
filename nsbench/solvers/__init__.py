"""Solvers by name, one run of them, and what the file of a user's own solver needs."""

from __future__ import annotations

from nsbench.case import Case
from nsbench.solvers.base import (
    Claims,
    Expect,
    Grid,
    Run,
    Solver,
    check_positive,
    grid,
    last_steps,
    sample,
)
from nsbench.solvers.registry import (
    all_names,
    broken,
    broken_plugins,
    get,
    load,
    plugin_files,
    solve,
    spec_of,
    standard,
)
from nsbench.trajectory import Event, Status, Trajectory

__all__ = [
    "Case",
    "Claims",
    "Event",
    "Expect",
    "Grid",
    "Run",
    "Solver",
    "Status",
    "Trajectory",
    "all_names",
    "broken",
    "broken_plugins",
    "check_positive",
    "get",
    "grid",
    "last_steps",
    "load",
    "plugin_files",
    "sample",
    "solve",
    "spec_of",
    "standard",
]
