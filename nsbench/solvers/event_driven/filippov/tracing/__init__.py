"""Tapes: the functions of a case as lists of scalar operations that compiled kernels interpret.

`trace` runs a factory once on arrays of nodes and gives a `graph`; graphs know derivatives;
`program` lays the part of a graph that some outputs need out in arrays. The kernels
(nsbench.solvers.event_driven.filippov.kernels.taylor_series, .enclosure) are compiled once, for any
tape.
"""
