"""solve_ivp: see method.py."""

from nsbench.solvers.solve_ivp.method import SOLVER

__all__ = ["SOLVER"]
