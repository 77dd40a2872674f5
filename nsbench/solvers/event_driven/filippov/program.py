"""Programs of the modes of a Filippov system: its functions, traced once, for the compiled loop.

A mode off all surfaces has the field of its signs. A mode that slides on surface i has the two
fields of its sides, and from them, by operations of the program too, Filippov's sign
s = (c' + c'-) / (c'- - c'+) and the velocity. Modes that slide on several surfaces have no program:
there, and wherever a case cannot be traced, event_driven.filippov.host_loop goes on in numpy.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from nsbench.compilation.factories import as_numpy
from nsbench.problem import Filippov
from nsbench.solvers.event_driven.filippov.kernels.loop_state import (
    Modes,
    Programs,
    Workspace,
)
from nsbench.solvers.event_driven.filippov.tracing.graph import Graph
from nsbench.solvers.event_driven.filippov.tracing.layout import lay_out
from nsbench.solvers.event_driven.filippov.tracing.trace import SPACE, UNTRACEABLE, inputs, vector

MOST_SURFACES = 4  # 2^d fields are traced
PROBES = 5  # points at which the programs must agree with the case
AGREEMENT = 1e-12  # relative to the largest entry: both round, in another order
# orders of the series: below, more steps cost more than the terms they save
LEAST_ORDER = 18
LARGEST_ORDER = 22
LOCAL_SHARE = 0.03  # of the tolerance goes to one step (as in smooth.arc)


class TracedPrograms:
    """Programs of the modes of a case with n states and d surfaces."""

    def __init__(self, programs: Programs, modes: Modes, n: int, d: int):
        self.programs = programs
        self.modes = modes
        self.n = n
        self.d = d

    def workspace(self, p: int) -> Workspace:
        """Return work arrays of a run of order p."""
        from nsbench.solvers.event_driven.filippov.kernels.enclosure import ORDER
        from nsbench.solvers.event_driven.filippov.kernels.polynomial_root import DEEP

        rows = self.programs.rows
        n = self.n
        d = self.d
        return Workspace(
            C=np.zeros((rows, p + 1)),
            Q=np.zeros((n + d + 1, p + 1)),
            M=np.zeros((rows, ORDER + 1)),
            R=np.zeros((rows, ORDER + 1)),
            V=np.zeros((rows, ORDER)),
            error=np.zeros(d + 1),
            lift=np.zeros(d + 1),
            band=np.zeros(d + 1),
            stack=np.zeros((2 * DEEP + 4, 2)),
            shifted=np.zeros((1, p + 1)),
            G=np.zeros((d, n + 2)),
            F=np.zeros((2, n)),
            y=np.zeros(n),
            D=np.zeros((rows, p + 1)),
        )


def series_order(tol: float) -> int:
    """Return the order of the series for an error tol of the run (Jorba & Zou 2005, section
    3.1)."""
    order = np.ceil(-0.5 * np.log(LOCAL_SHARE * tol)) + 1
    return int(np.clip(order, LEAST_ORDER, LARGEST_ORDER))


def trace_programs(problem: Filippov, d: int, t0: float, x0: np.ndarray) -> TracedPrograms | None:
    """Trace the programs of a Filippov problem with d surfaces; None if it cannot be traced or if
    the programs do not compute what the case computes."""
    if d > MOST_SURFACES:
        return None
    n = x0.size
    graph = Graph(n)
    try:
        outputs, geometry = _trace(graph, problem, n, d)
        lists = [*outputs.values(), geometry]
        width = max(n + d + 2, len(geometry))
        programs = lay_out(graph, [row + [-1] * (width - len(row)) for row in lists])
    except UNTRACEABLE:
        return None
    table = np.full(3**d, -1)
    for m, q in enumerate(outputs):
        table[sum((v + 1) * 3**i for i, v in enumerate(q))] = m
    slides = np.array([q.index(0) if 0 in q else -1 for q in outputs])
    traced = TracedPrograms(programs, Modes(table, slides), n, d)
    return traced if _agrees(traced, problem, list(outputs), t0, x0) else None


def _trace(graph, problem, n, d):
    """Outputs of each mode that slides on at most one surface, and those of the geometry: gradient,
    time derivative and value of each switch function."""
    t, x = inputs(graph)
    field = problem.field(SPACE)
    fields = {
        q: vector(graph, field(t, x, np.array(q, float)), n) for q in product((1, -1), repeat=d)
    }
    c = vector(graph, problem.switch(SPACE)(t, x), d)
    derivatives = [{} for _ in range(n + 1)]
    slopes = [[graph.derivative(k, j, derivatives[j]) for j in range(n + 1)] for k in c]
    outputs = {}
    for q in product((1, 0, -1), repeat=d):
        if q.count(0) > 1:
            continue
        if 0 in q:
            out = _sliding_outputs(graph, fields, c, slopes, q, n)
        else:
            out = _free_outputs(graph, fields, c, q)
        if out:
            outputs[q] = out
    geometry = [v for row, value in zip(slopes, c, strict=True) for v in (*row, value)]
    return outputs, geometry


def _free_outputs(graph, fields, c, q):
    """Outputs of a mode off all surfaces: field, distances to the surfaces, weight."""
    return [
        *fields[q],
        *(graph.mul(graph.const(v), k) for v, k in zip(q, c, strict=True)),
        -1,
        *([graph.const(0.5 * (1 + q[0]))] if q else [-1]),
    ]


def _sliding_outputs(graph, fields, c, slopes, q, n):
    """Outputs of a mode that slides on the surface i with q_i = 0 (Filippov 1988, section 4); None
    if no sign changes c_i'."""
    i = q.index(0)
    plus, minus = (fields[(*q[:i], v, *q[i + 1 :])] for v in (1, -1))
    rates = []
    for F in (plus, minus):
        rate = slopes[i][n]
        for slope, f in zip(slopes[i], F, strict=False):
            rate = graph.add(rate, graph.mul(slope, f))
        rates.append(rate)
    gap = graph.sub(rates[1], rates[0])
    if graph.value(gap) == 0.0:
        return None
    # of the positive and negative side
    theta = graph.div(rates[1], gap)
    rest = graph.neg(graph.div(rates[0], gap))
    F = [
        a if a == b else graph.add(graph.mul(theta, a), graph.mul(rest, b))
        for a, b in zip(plus, minus, strict=True)
    ]
    two = graph.const(2.0)
    watch = [graph.mul(graph.const(v), k) for v, k in zip(q, c, strict=True)]
    watch[i] = graph.mul(two, rest)  # 1 - s
    return [*F, *watch, graph.mul(two, theta), theta]


def _agrees(traced, problem, modes, t0, x0) -> bool:
    """Do the programs of the modes off the surfaces give what the case's own functions give, at
    PROBES points near the start?"""
    from nsbench.solvers.event_driven.filippov.kernels.mode_choice import evaluate_program

    field = as_numpy(problem.field)
    switch = as_numpy(problem.switch)
    programs = traced.programs
    V = np.zeros((programs.rows, 1))
    rng = np.random.default_rng(0)
    for k in range(PROBES):
        scale = 0.3 * k * (1.0 + np.abs(x0).max(initial=0.0))
        t = t0 + 0.7 * k
        x = x0 + scale * rng.uniform(-1, 1, x0.size)
        for m, q in enumerate(modes):
            if 0 in q:
                continue
            evaluate_program(programs, m, float(t), x, V)
            values = V[programs.outs[m, : traced.n + traced.d], 0]
            with np.errstate(all="ignore"):
                expected = np.concatenate([field(t, x, np.array(q, float)), q * switch(t, x)])
            off = np.abs(values - expected)
            finite = np.isfinite(expected)
            if not np.array_equal(np.isfinite(values), finite):
                return False
            if np.any(off[finite] > AGREEMENT * (1.0 + np.abs(expected[finite]).max(initial=0.0))):
                return False
    return True
