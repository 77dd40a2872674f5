"""penalty: see method.py."""

from nsbench.solvers.penalty.method import SOLVER

__all__ = ["SOLVER"]
