"""Implicit theta stepping for linear complementarity systems and linear constraints.

See method.py.
"""

from nsbench.solvers.theta.method import SOLVER

__all__ = ["SOLVER"]
