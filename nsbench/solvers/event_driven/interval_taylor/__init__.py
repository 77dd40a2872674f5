"""Interval Taylor arithmetic: proven bounds on a function of time, and on its derivatives, over
pieces of an interval (see interval_taylor.jet)."""

from nsbench.solvers.event_driven.interval_taylor.jet import (
    ORDER,
    SPACE,
    Jet,
    as_jet,
    clock,
    path,
)
from nsbench.solvers.event_driven.interval_taylor.numpy_functions import register

__all__ = ["ORDER", "SPACE", "Jet", "as_jet", "clock", "path"]

register()
