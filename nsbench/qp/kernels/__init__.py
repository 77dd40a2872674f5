"""Compiled solvers of the projection QP (see nsbench.qp)."""
