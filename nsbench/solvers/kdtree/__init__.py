"""Baseline: PBD for discs in a box as users write it, with pairs from SciPy's cKDTree."""

from nsbench.solvers.kdtree.method import SOLVER

__all__ = ["SOLVER"]
