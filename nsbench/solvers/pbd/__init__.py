"""Position-based dynamics: an Euler step, then sweeps of exact projections (see method.py)."""

from nsbench.solvers.pbd.method import SOLVER

__all__ = ["SOLVER"]
