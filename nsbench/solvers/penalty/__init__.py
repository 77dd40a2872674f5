"""Penalty method: constraints as stiff springs, Filippov fields smoothed over a layer.

See method.py.
"""

from nsbench.solvers.penalty.method import SOLVER

__all__ = ["SOLVER"]
