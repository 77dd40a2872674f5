"""Event-driven method: smooth arcs between located events, for all four problem classes.

method: options and choice of the problem class. contacts: Complementarity systems. filippov:
Filippov systems. lcs: linear complementarity systems. hybrid: hybrid systems. smooth: integration
of one smooth arc to its first event. accumulation: Zeno behaviour.
"""

from nsbench.solvers.event_driven.method import SOLVER

__all__ = ["SOLVER"]
