"""Explicit and implicit Euler on Filippov fields and on smooth systems (see method.py)."""

from nsbench.solvers.euler.method import SOLVER

__all__ = ["SOLVER"]
