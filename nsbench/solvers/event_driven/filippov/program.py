"""Programs of the modes of a Filippov system: its functions, traced once, for the compiled loop.

A mode off all surfaces has the field of its signs. A mode that slides on surface i has the two
fields of its sides, and from them, by operations of the program too, Filippov's sign
s = (c' + c'-) / (c'- - c'+) and the velocity. Modes that slide on several surfaces have no program:
there, and wherever a case cannot be traced, event_driven.filippov.host_loop goes on in numpy.
A kink of the fields or switches adds two watched functions; one at a switching surface has the
state of the mode's side.
"""

from __future__ import annotations

from functools import partial
from itertools import product

import numpy as np

from nsbench.compilation.factories import as_numpy
from nsbench.problem import Filippov
from nsbench.solvers.event_driven.filippov.kernels.loop_state import (
    Modes,
    Programs,
    Workspace,
)
from nsbench.solvers.event_driven.filippov.tracing import kinks
from nsbench.solvers.event_driven.filippov.tracing.graph import Graph
from nsbench.solvers.event_driven.filippov.tracing.layout import lay_out, nodes_needed
from nsbench.solvers.event_driven.filippov.tracing.refusals import UNTRACEABLE, describe_refusal
from nsbench.solvers.event_driven.filippov.tracing.trace import SPACE, inputs, vector

MOST_SURFACES = 4  # 2^d fields are traced
APART = 0.7  # times between them
PROBES = 5  # points at which the programs must agree with the case
AGREEMENT = 1e-12  # relative to the largest entry: both round, in another order
# orders of the series: below, more steps cost more than the terms they save
LEAST_ORDER = 18
LARGEST_ORDER = 22
LOCAL_SHARE = 0.03  # of the tolerance goes to one step (as in smooth.arc)


class TracedPrograms:
    """Programs of the modes of a case with n states and d surfaces.

    places: operation and line of the user's file of each kink. watches: number of watched
    functions.
    """

    def __init__(self, programs: Programs, modes: Modes, n: int, d: int, places: tuple[str, ...]):
        self.programs = programs
        self.modes = modes
        self.n = n
        self.d = d
        self.places = places
        self.watches = d + 2 * len(places) + 1

    def place_kinks(self, t: float, x: np.ndarray, V: np.ndarray) -> bool:
        """Set the states of the kinks by the values of their arguments at (t, x); is none at its
        break? V: work (rows, 1)."""
        from nsbench.solvers.event_driven.filippov.kernels.kink_branches import place_kinks

        G = np.zeros((self.d + len(self.places), self.n + 2))
        place_kinks(self.programs, self.d, -1, float(t), x, V, G)
        table = self.programs.kinks
        size = 1.0 + np.abs(x).max(initial=abs(t))
        for (lo, count, _, _), row in zip(table.spans, G[self.d :], strict=True):
            distance = np.abs(row[-1] - table.breaks[lo : lo + count]).min()
            if not distance > AGREEMENT * size * (1.0 + np.abs(row[:-1]).max()):
                return False
        return True

    def workspace(self, p: int) -> Workspace:
        """Return work arrays of a run of order p."""
        from nsbench.solvers.event_driven.filippov.kernels.enclosure import ORDER
        from nsbench.solvers.event_driven.filippov.kernels.polynomial_root import DEEP

        rows = self.programs.rows
        n = self.n
        w = self.watches
        return Workspace(
            C=np.zeros((rows, p + 1)),
            Q=np.zeros((n + w, p + 1)),
            M=np.zeros((rows, ORDER + 1)),
            R=np.zeros((rows, ORDER + 1)),
            V=np.zeros((rows, ORDER)),
            error=np.zeros(w),
            lift=np.zeros(w),
            band=np.zeros(w),
            stack=np.zeros((2 * DEEP + 4, 2)),
            shifted=np.zeros((1, p + 1)),
            G=np.zeros((self.d + len(self.places), n + 2)),
            F=np.zeros((2, n)),
            y=np.zeros(n),
            D=np.zeros((rows, p + 1)),
        )


def series_order(tol: float) -> int:
    """Return the order of the series for an error tol of the run (Jorba & Zou 2005, section
    3.1)."""
    order = np.ceil(-0.5 * np.log(LOCAL_SHARE * tol)) + 1
    return int(np.clip(order, LEAST_ORDER, LARGEST_ORDER))


class UntraceableError(Exception):
    """A case has no programs; the message says why, with the line of the user's file."""


def trace_programs(
    problem: Filippov, d: int, times: tuple[float, float], x0: np.ndarray
) -> TracedPrograms:
    """Trace the programs of a Filippov problem with d surfaces for a run between two times.

    Raises UntraceableError if it cannot be traced, or if the programs do not compute what the case
    computes.
    """
    if d > MOST_SURFACES:
        raise UntraceableError(
            f"{d} switching surfaces have 2^{d} fields; up to {MOST_SURFACES} are traced"
        )
    n = x0.size
    t0 = times[0]
    try:
        graph = Graph(n, (t0, max(times[1], t0 + APART * PROBES)))
        outputs, geometry, sides = _trace(graph, problem, n, d)
        lists = [*outputs.values(), geometry]
        width = max(map(len, lists))
        programs = lay_out(graph, [row + [-1] * (width - len(row)) for row in lists])
    except UNTRACEABLE as e:
        raise UntraceableError(describe_refusal(e)) from None
    table = np.full(3**d, -1)
    for m, q in enumerate(outputs):
        table[sum((v + 1) * 3**i for i, v in enumerate(q))] = m
    slides = np.array([q.index(0) if 0 in q else -1 for q in outputs])
    places = tuple(k.place for k in graph.kinks)
    traced = TracedPrograms(programs, Modes(table, slides), n, d, places)
    if not _agrees(traced, problem, list(outputs), sides, t0, x0):
        raise UntraceableError(
            "what is traced differs from what numpy computes: the functions must depend on their "
            "arguments alone"
        )
    return traced


def _trace(graph, problem, n, d):
    """Outputs of each mode that slides on at most one surface; those of the geometry: gradient,
    time derivative and value of each switch function and each argument of a kink; and for each
    surface the kink at it and its states on both sides, or None."""
    t, x = inputs(graph)
    field = problem.field(SPACE)
    fields = {
        q: vector(graph, field(t, x, np.array(q, float)), n) for q in product((1, -1), repeat=d)
    }
    c = vector(graph, problem.switch(SPACE)(t, x), d)
    sides = [kinks.states_on_sides(graph, k) for k in c]
    rows = partial(nodes_needed, graph)
    for q in fields:
        states = {s[0]: s[1][v < 0] for v, s in zip(q, sides, strict=True) if s is not None}
        fields[q] = kinks.resolved(graph, fields[q], states, rows)
    derivatives = [{} for _ in range(n + 1)]
    slopes_of = lambda k: [graph.derivative(k, j, derivatives[j]) for j in range(n + 1)]
    slopes = [slopes_of(k) for k in c]
    watches = [kinks.watches(graph, k) for k in range(len(graph.kinks))]
    outputs = {}
    for q in product((1, 0, -1), repeat=d):
        if q.count(0) > 1:
            continue
        if 0 in q:
            out = _sliding_outputs(graph, fields, c, slopes, q, n)
        else:
            out = _free_outputs(graph, fields, c, q)
        if out:
            # those of the switches too: a surface may jump away from what slides on it
            needed = kinks.kinks_needed(graph, [k for k in (*out, *c) if k >= 0], rows)
            for k, pair in enumerate(watches):
                out[n + d + 2 * k : n + d + 2 * k] = pair if k in needed else (-1, -1)
            outputs[q] = out
    arguments = [k.node for k in graph.kinks]
    slopes += [slopes_of(k) for k in arguments]
    geometry = [v for row, value in zip(slopes, c + arguments, strict=True) for v in (*row, value)]
    return outputs, geometry, sides


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


def _agrees(traced, problem, modes, sides, t0, x0) -> bool:
    """Do the programs of the modes off the surfaces give what the case's own functions give, at
    PROBES points near the start? At a kink they need not; modes with a kink at a surface are
    compared on their side of it."""
    from nsbench.solvers.event_driven.filippov.kernels.mode_choice import evaluate_program

    field = as_numpy(problem.field)
    switch = as_numpy(problem.switch)
    programs = traced.programs
    V = np.zeros((programs.rows, 1))
    rng = np.random.default_rng(0)
    one_sided = np.array([s is not None for s in sides], bool)
    for k in range(PROBES):
        scale = 0.3 * k * (1.0 + np.abs(x0).max(initial=0.0))
        t = t0 + APART * k
        x = x0 + scale * rng.uniform(-1, 1, x0.size)
        if traced.places and not traced.place_kinks(t, x, V):
            continue
        for m, q in enumerate(modes):
            if 0 in q:
                continue
            with np.errstate(all="ignore"):
                c = q * switch(t, x)
                if np.any(one_sided & ~(c > 0.0)):
                    continue
                expected = np.concatenate([field(t, x, np.array(q, float)), c])
            evaluate_program(programs, m, float(t), x, V)
            values = V[programs.outs[m, : traced.n + traced.d], 0]
            off = np.abs(values - expected)
            finite = np.isfinite(expected)
            if not np.array_equal(np.isfinite(values), finite):
                return False
            if np.any(off[finite] > AGREEMENT * (1.0 + np.abs(expected[finite]).max(initial=0.0))):
                return False
    return True
