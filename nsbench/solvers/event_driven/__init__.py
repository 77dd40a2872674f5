"""event_driven: see method.py."""

from nsbench.solvers.event_driven.method import SOLVER

__all__ = ["SOLVER"]
