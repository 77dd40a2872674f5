"""pbd_jax: see method.py."""

from nsbench.solvers.pbd_jax.method import SOLVER

__all__ = ["SOLVER"]
