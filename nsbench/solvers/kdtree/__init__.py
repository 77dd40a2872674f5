"""kdtree: see method.py."""

from nsbench.solvers.kdtree.method import SOLVER

__all__ = ["SOLVER"]
