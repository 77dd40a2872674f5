"""Cases solved by the package nosnoc: time stepping with switch detection (see method.py)."""

from nsbench.solvers.nosnoc.method import SOLVER

__all__ = ["SOLVER"]
