"""Position-based dynamics in JAX, for a GPU or a CPU (see method.py)."""

from nsbench.solvers.pbd_jax.method import SOLVER

__all__ = ["SOLVER"]
