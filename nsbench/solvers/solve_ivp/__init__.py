"""Baseline: SciPy's solve_ivp with modes and events written by hand (see method.py)."""

from nsbench.solvers.solve_ivp.method import SOLVER

__all__ = ["SOLVER"]
