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
from nsbench.solvers.registry import all_names, broken, get, load, solve, spec_of, standard
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
    "check_positive",
    "get",
    "grid",
    "last_steps",
    "load",
    "sample",
    "solve",
    "spec_of",
    "standard",
]
