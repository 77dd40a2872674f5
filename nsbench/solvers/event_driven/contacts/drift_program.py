"""Programs of the drifts of constrained cases: traced operations, for the compiled loop.

A drift without kinks is a DriftProgram, whose Taylor series kernels.traced_drift computes along the
motion; one with abs, max or sign has a branch for each state of its kinks, which kinked_drift holds
in the loop in Python.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from nsbench.case import Case
from nsbench.solvers.event_driven.contacts.kernels.loop_state import AffineDrift, DriftProgram
from nsbench.solvers.event_driven.filippov.kernels import opcodes as op
from nsbench.solvers.event_driven.filippov.program import (
    TracedPrograms,
    UntraceableError,
    trace_programs,
)
from nsbench.solvers.event_driven.filippov.tracing.graph import Graph
from nsbench.solvers.event_driven.filippov.tracing.refusals import describe_refusal
from nsbench.solvers.event_driven.filippov.tracing.trace import SPACE, inputs, vector

TWO_ROWS = (op.ADD, op.SUB, op.MUL, op.DIV, op.LOG, op.ATAN)  # operations with a row b
NO_PROGRAM = DriftProgram(
    np.empty((0, 3), np.int64),
    np.empty((0, 2)),
    np.zeros(3, np.int64),
    np.empty(0, np.int64),
    *(np.empty((0, 0)) for _ in range(5)),
    np.empty(0),
)


def trace_drift(case: Case, needs_kinks: bool) -> tuple[TracedPrograms | None, str]:
    """Trace the drift of a Complementarity case; None and why if it cannot be traced.

    needs_kinks: None as well, and no kernel loaded, where the drift has no kinks.
    """
    drift = case.problem.drift
    times = float(case.t[0]), float(case.t[-1])
    try:
        graph = Graph(case.n, times)
        vector(graph, drift(SPACE)(*inputs(graph)), case.n)
    except Exception as e:  # user code, on arrays that it does not know
        return None, describe_refusal(e)
    if needs_kinks and not graph.kinks:
        return None, ""
    problem = SimpleNamespace(
        field=lambda xp: (lambda f: lambda t, x, s: f(t, x))(drift(xp)),
        switch=lambda xp: lambda t, x: np.zeros(0),
    )
    try:
        return trace_programs(problem, 0, times, case.x0), ""
    except UntraceableError as e:
        return None, str(e)


def drift_program(traced: TracedPrograms, order: int) -> DriftProgram:
    """Return the program of a drift without kinks, with the work arrays of series of an order."""
    from nsbench.solvers.event_driven.filippov.kernels.enclosure import ORDER

    ops, nums, first, outs, rows, _ = traced.programs
    n = traced.n
    count = first[0, -1]
    return DriftProgram(
        ops[:count],
        nums[:count],
        first[0],
        outs[0, :n],
        np.zeros((rows, order + 1)),
        np.zeros((2 * n, order + 1)),
        np.zeros((rows, ORDER + 1)),
        np.zeros((rows, ORDER + 1)),
        np.zeros((rows, ORDER)),
        np.full(1, np.inf),
    )


def dependences(traced: TracedPrograms) -> AffineDrift:
    """Find which x_j each f_i depends on, as a matrix of zeros."""
    n = traced.n
    ops, _, first, outs, _, _ = traced.programs
    needed = [1 << i for i in range(n)] + [0]  # sets of coordinates as bits, row by row
    for code, a, b in ops[: first[0, -1]].tolist():
        bits = 0 if code == op.CONST else needed[a]
        needed.append(bits | needed[b] if code in TWO_ROWS else bits)
    columns = [[j for j in range(n) if needed[row] >> j & 1] for row in outs[0, :n].tolist()]
    ptr = np.zeros(n + 1, np.int64)
    np.cumsum([len(c) for c in columns], out=ptr[1:])
    cols = np.array([j for c in columns for j in c], np.int64)
    return AffineDrift(ptr, cols, np.zeros(len(cols)), np.zeros(n))
