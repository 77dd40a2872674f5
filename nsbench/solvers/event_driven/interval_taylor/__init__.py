"""Interval Taylor arithmetic: proven bounds on functions of time and on their derivatives.

Over pieces of an interval (see interval_taylor.jet).
"""

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
