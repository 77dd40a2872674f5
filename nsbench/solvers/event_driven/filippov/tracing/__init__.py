"""Trace a case's functions into programs: lists of scalar operations that kernels interpret.

`trace` runs a factory once on arrays of nodes and gives a `graph`; graphs know derivatives.
numpy_functions: what numpy does on such arrays. kinks: functions that are not smooth. refusals:
sentences on what cannot be traced, with the line (source_lines). `layout` writes the part of a
graph that some outputs need as arrays. The kernels (event_driven.filippov.kernels.taylor_series,
.enclosure) are compiled once, for any program.
"""

from nsbench.solvers.event_driven.filippov.tracing import numpy_functions  # noqa: F401  (registers)
