"""The tapes of a Filippov system: programs of its modes, traced once, and the compiled walk on
them.

A mode beside all surfaces has the field of its signs. A mode that slides on surface i has the two
fields beside it, and from them, by operations of the tape too, Filippov's signs s = (c' + c'-) /
(c'- - c'+) and the velocity. Modes that slide on several surfaces have no program: there, and
wherever a case cannot be traced, solvers._switching goes on in numpy.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from nsbench.compilation.factories import as_numpy
from nsbench.solvers.event_driven.filippov.tracing.graph import Graph
from nsbench.solvers.event_driven.filippov.tracing.layout import lay_out
from nsbench.solvers.event_driven.filippov.tracing.trace import SPACE, UNTRACEABLE, inputs, vector

MOST = 4  # surfaces: 2^d fields are traced
ROOM = 256  # events that one call of the walk can note
PROBES = 5  # points at which the tape must agree with the case
AGREES = 1e-12  # relative to the largest entry: both round, in another order
# orders of the series: below, more steps cost more than the terms they save
LEAST = 18
LARGEST = 22
SHARE = 0.03  # of the tolerance goes to one step (as in _arc)


class Tape:
    """tape, table, slides: what kernels.filippov.walk takes."""

    def __init__(self, programs, table, slides, n, d):
        self.arrays = programs.ops, programs.nums, programs.first, programs.outs
        self.table = table
        self.slides = slides
        self.rows = programs.rows
        self.n = n
        self.d = d

    def scratch(self, p: int) -> tuple:
        """Work space of a walk of order p."""
        from nsbench.solvers.event_driven.filippov.kernels.enclosure import ORDER
        from nsbench.solvers.event_driven.filippov.kernels.polynomial_root import DEEP

        rows = self.rows
        n = self.n
        d = self.d
        return (
            np.zeros((rows, p + 1)),
            np.zeros((n + d + 1, p + 1)),
            np.zeros((rows, ORDER + 1)),
            np.zeros((rows, ORDER + 1)),
            np.zeros((rows, ORDER)),
            np.zeros(d + 1),
            np.zeros(d + 1),
            np.zeros((2 * DEEP + 4, 2)),
            np.zeros((1, p + 1)),
            np.zeros(d + 1),
            np.zeros((d, n + 2)),
            np.zeros((2, n)),
            np.zeros(n),
            np.zeros((rows, p + 1)),
        )


def order(tol: float) -> int:
    """Order of the series for an error tol of the run (Jorba & Zou 2005, section 3.1)."""
    return int(np.clip(np.ceil(-0.5 * np.log(SHARE * tol)) + 1, LEAST, LARGEST))


def tape(problem, d: int, t0: float, x0: np.ndarray) -> Tape | None:
    """The tape of a Filippov problem with d surfaces; None if it cannot be traced or is not what
    the case computes."""
    if d > MOST:
        return None
    n = x0.size
    graph = Graph(x0.size)
    t, x = inputs(graph)
    try:
        field = problem.field(SPACE)
        fields = {
            q: vector(graph, field(t, x, np.array(q, float)), n) for q in product((1, -1), repeat=d)
        }
        c = vector(graph, problem.switch(SPACE)(t, x), d)
        seen = [{} for _ in range(n + 1)]
        slopes = [[graph.derivative(k, j, seen[j]) for j in range(n + 1)] for k in c]
        found = {
            q: _sliding(graph, fields, c, slopes, q, n, d)
            if 0 in q
            else _beside(graph, fields, c, q)
            for q in product((1, 0, -1), repeat=d)
            if q.count(0) <= 1
        }
        modes, outputs = zip(*((q, out) for q, out in found.items() if out), strict=True)
        shape = [v for row, value in zip(slopes, c, strict=True) for v in (*row, value)]
        width = max(n + d + 2, len(shape))
        made = lay_out(graph, [row + [-1] * (width - len(row)) for row in [*outputs, shape]])
    except UNTRACEABLE:
        return None
    table = np.full(3**d, -1)
    for m, q in enumerate(modes):
        table[sum((v + 1) * 3**i for i, v in enumerate(q))] = m
    slides = np.array([q.index(0) if 0 in q else -1 for q in modes])
    out = Tape(made, table, slides, n, d)
    return out if _agrees(out, problem, modes, t0, x0) else None


def _beside(graph, fields, c, q):
    return [
        *fields[q],
        *(graph.mul(graph.const(v), k) for v, k in zip(q, c, strict=True)),
        -1,
        *([graph.const(0.5 * (1 + q[0]))] if q else [-1]),
    ]


def _sliding(graph, fields, c, slopes, q, n, d):
    """Outputs of a mode that slides on the surface i with q_i = 0 (Filippov 1988, section 4); None:
    no sign does anything."""
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


def _agrees(made, problem, modes, t0, x0) -> bool:
    """Whether the programs beside the surfaces give what the case's own functions give, near the
    start."""
    from nsbench.solvers.event_driven.filippov.kernels.mode_choice import at

    field = as_numpy(problem.field)
    switch = as_numpy(problem.switch)
    V = np.zeros((made.rows, 1))
    rng = np.random.default_rng(0)
    for k in range(PROBES):
        scale = 0.3 * k * (1.0 + np.abs(x0).max(initial=0.0))
        t = t0 + 0.7 * k
        x = x0 + scale * rng.uniform(-1, 1, x0.size)
        for m, q in enumerate(modes):
            if 0 in q:
                continue
            at(*made.arrays, m, made.n, float(t), x, V)
            got = V[made.arrays[3][m, : made.n + made.d], 0]
            with np.errstate(all="ignore"):
                want = np.concatenate([field(t, x, np.array(q, float)), q * switch(t, x)])
            off = np.abs(got - want)
            same = np.isfinite(want)
            if not np.array_equal(np.isfinite(got), same):
                return False
            if np.any(off[same] > AGREES * (1.0 + np.abs(want[same]).max(initial=0.0))):
                return False
    return True
