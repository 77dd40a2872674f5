"""Projection onto linearised constraints: a strictly convex quadratic program and its solvers.

    min 1/2 |d|^2  s.t.  q + G d >= 0        d = G^T mu,    0 <= mu  _|_  w = q + G d >= 0

G (m, n) holds the gradients of m constraints, q (m,) their gaps; d is the shortest displacement to
the linearised feasible set and mu the multipliers. Rows may depend on each other: d is unique, mu
need not be. Small problems are solved exactly by three phases (qp.kernels.active_set): block
exchange, projected Newton on the dual, and the dual method of Goldfarb & Idnani. Large ones update
the working set of the step before, or use a primal-dual interior-point method
(qp.kernels.large_callback). `projection` is the face for Python.
"""
