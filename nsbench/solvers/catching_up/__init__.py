"""catching_up: see method.py."""

from nsbench.solvers.catching_up.method import SOLVER

__all__ = ["SOLVER"]
