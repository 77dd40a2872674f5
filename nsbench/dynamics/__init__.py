"""Evaluate what the problems of the bench are made of: constraints, Filippov fields, LCS inputs,
length scales.

contacts: gaps, gradients and candidate contacts of constraint families. filippov: modes, rates of
switch functions, convex hulls. lcs: linear complementarity systems. length_scale: the
characteristic length of a case.
"""
