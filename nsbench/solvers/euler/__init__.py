"""euler: see method.py."""

from nsbench.solvers.euler.method import SOLVER

__all__ = ["SOLVER"]
