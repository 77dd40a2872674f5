"""nosnoc: see method.py."""

from nsbench.solvers.nosnoc.method import SOLVER

__all__ = ["SOLVER"]
