"""theta: see method.py."""

from nsbench.solvers.theta.method import SOLVER

__all__ = ["SOLVER"]
