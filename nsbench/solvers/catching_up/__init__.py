"""Catching-up (Moreau) time stepping: an Euler step, then projection by a QP (see method.py)."""

from nsbench.solvers.catching_up.method import SOLVER

__all__ = ["SOLVER"]
