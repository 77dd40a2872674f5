"""Interval Taylor arithmetic: proven bounds on functions of time and on their derivatives.

Over pieces of an interval (see interval_taylor.jet).
"""

from nsbench.dynamics.interval_taylor.jet import (
    ORDER,
    SPACE,
    Jet,
    as_jet,
    clock,
    enclosing,
    path,
)
from nsbench.dynamics.interval_taylor.numpy_functions import register

__all__ = ["ORDER", "SPACE", "Jet", "as_jet", "clock", "enclosing", "path"]

register()
