"""Evaluate what problems consist of: constraints, Filippov fields, LCS inputs, units.

contacts: gaps, gradients and candidate contacts of constraint families. filippov: modes, rates of
switch functions, convex hulls. lcs: linear complementarity systems. scaling: a case
in its own units. length_scale: the characteristic length of one that is run in the user's.
interval_taylor: enclosures of the functions of a case.
"""
