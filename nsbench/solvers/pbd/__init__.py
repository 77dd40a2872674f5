"""pbd: see method.py."""

from nsbench.solvers.pbd.method import SOLVER

__all__ = ["SOLVER"]
