"""Kinks of a traced function: nodes of abs, max, sign and tables, and the nodes that need them.

A kink has an argument a (a node) and breaks b_1 < ... < b_m; its state 0 .. m counts the breaks
below a. Between two changes of states a function is smooth: LOOKUP is a constant per state, SELECT
one of two nodes. So |a| is SELECT(-a, a) on the kink (a; 0), a table a LOOKUP of slopes and values.
"""

from __future__ import annotations

import bisect
import math
from typing import NamedTuple

import numpy as np

from nsbench.solvers.event_driven.filippov.kernels.opcodes import (
    ADD,
    AFFINE,
    CONST,
    DIV,
    MUL,
    SUB,
)
from nsbench.solvers.event_driven.filippov.tracing.graph import LOOKUP, SELECT, Graph
from nsbench.solvers.event_driven.filippov.tracing.source_lines import calling_line

MOST_JUMPS = 1_000_000  # of a floor in a run


class Kink(NamedTuple):
    """Argument and breaks of a kink; place: the operation and line of the user's file."""

    node: int
    breaks: tuple[float, ...]
    place: str


def kink(graph: Graph, node: int, breaks: tuple[float, ...], what: str) -> int:
    """Return the number of the kink with this argument and these breaks; what: the operation."""
    key = node, breaks
    if key not in graph.kink_numbers:
        graph.kink_numbers[key] = len(graph.kinks)
        graph.kinks.append(Kink(node, breaks, f"`{what}` in {calling_line()}"))
    return graph.kink_numbers[key]


def lookup(graph: Graph, k: int, values: list[float]) -> int:
    """Return the node of a constant per state of kink k."""
    return graph.lookup(k, tuple(float(v) for v in values))


def sign_place(graph: Graph, a: int) -> tuple[int, float, bool]:
    """Return (node, break, up) such that a > 0 where the node is above the break (up) or below.

    Arguments that differ by a factor and a constant, or in their sign, have one node.
    """
    node = a
    at = 0.0
    up = True
    op, u, _, c, d = graph.nodes[a]
    if op == AFFINE:
        node = u
        at = 0.0 - d / c
        up = c > 0.0
    op, u, v, _, _ = graph.nodes[node]
    if op == SUB and u > v:
        node = graph.sub(v, u)
        at = 0.0 - at
        up = not up
    return node, at, up


def states_on_sides(graph: Graph, c: int) -> tuple[int, tuple[int, int]] | None:
    """Return the kink at the surface c = 0 and its states for c > 0 and c < 0; None without one."""
    node, at, up = sign_place(graph, c)
    k = graph.kink_numbers.get((node, (at,)))
    return None if k is None else (k, (1, 0) if up else (0, 1))


def resolved(graph: Graph, wanted: list[int], states: dict[int, int], rows) -> list[int]:
    """Return the nodes with the given states of kinks put in; rows: the nodes that nodes need."""
    if not states:
        return wanted
    new = {i: i for i in range(graph.n + 1)}
    for i in rows(wanted):
        op, a, b, c, d = graph.nodes[i]
        if op in (LOOKUP, SELECT) and int(c) in states:
            s = states[int(c)]
            new[i] = graph.const(graph.tables[int(d)][s]) if op == LOOKUP else new[(a, b)[s]]
        elif op == SELECT:
            new[i] = graph.select(int(c), [new[a], new[b]])
        elif all(new[r] == r for r in (a, b) if r >= 0):
            new[i] = i
        else:
            new[i] = graph.again(op, new[a], new.get(b, -1), c, d)
    return [new[i] for i in wanted]


def greater(graph: Graph, a: int, b: int, what: str) -> int:
    """Return the node of the truth of a > b: 1 or 0."""
    difference = graph.sub(a, b)
    fixed = graph.constants(difference)
    if fixed is not None:
        k, values = fixed
        truths = [1.0 * (v > 0.0) for v in values]
        return graph.const(truths[0]) if k is None else lookup(graph, k, truths)
    node, at, up = sign_place(graph, difference)
    k = kink(graph, node, (at,), what)
    return lookup(graph, k, [0.0, 1.0] if up else [1.0, 0.0])


def choose(graph: Graph, condition: int, a: int, b: int) -> int:
    """Return the node of a where the condition, a node of 0 and 1, is 1, and of b elsewhere.

    Raises TypeError where the condition is not made of comparisons.
    """
    if a == b:
        return a
    op, low, high, c, _ = graph.nodes[condition]
    fixed = graph.constants(condition)
    if fixed is not None:
        k, values = fixed
        if set(values) <= {0.0, 1.0}:
            picked = [a if v else b for v in values]
            return picked[0] if k is None else graph.select(k, picked)
    elif op == SELECT:
        return graph.select(int(c), [choose(graph, row, a, b) for row in (low, high)])
    raise TypeError("a condition that is no comparison cannot be traced; write it with < or >")


def absolute(graph: Graph, a: int) -> int:
    """Return the node of |a|."""
    return choose(graph, greater(graph, a, graph.const(0.0), "abs"), a, graph.neg(a))


def sign(graph: Graph, a: int) -> int:
    """Return the node of the sign of a: 1 or -1, which of them at 0 the motion decides."""
    truth = greater(graph, a, graph.const(0.0), "sign")
    return choose(graph, truth, graph.const(1.0), graph.const(-1.0))


def heaviside(graph: Graph, a: int, middle: int) -> int:
    """Return the node of 1 for a > 0 and 0 for a < 0."""
    return greater(graph, a, graph.const(0.0), "heaviside")


def maximum(graph: Graph, a: int, b: int) -> int:
    """Return the node of the larger of a and b."""
    return choose(graph, greater(graph, a, b, "maximum"), a, b)


def minimum(graph: Graph, a: int, b: int) -> int:
    """Return the node of the smaller of a and b."""
    return choose(graph, greater(graph, a, b, "minimum"), b, a)


def search(graph: Graph, table: np.ndarray, a: int) -> int:
    """Return the node of the number of entries of a sorted table below a."""
    breaks, counts = np.unique(np.asarray(table, float), return_counts=True)
    numbers = np.append(0, np.cumsum(counts))
    if graph.value(a) is not None:
        return graph.const(numbers[bisect.bisect_left(breaks, graph.value(a))])
    return lookup(graph, kink(graph, a, tuple(breaks.tolist()), "searchsorted"), numbers)


def take(graph: Graph, table: np.ndarray, index: int) -> int:
    """Return the node of an entry of a table; index: node of whole numbers per state of a kink."""
    fixed = graph.constants(index)
    if fixed is None:
        raise TypeError("an index that does not come from searchsorted cannot be traced")
    k, values = fixed
    entries = [float(table[int(v)]) for v in values]
    return graph.const(entries[0]) if k is None else lookup(graph, k, entries)


def interpolate(graph: Graph, a: int, x: np.ndarray, y: np.ndarray, ends: tuple) -> int:
    """Return the node of the piecewise linear function through (x, y); ends: beyond, or None."""
    if graph.value(a) is not None:
        return graph.const(np.interp(graph.value(a), x, y, *ends))
    if not (x.size and np.all(np.diff(x) > 0.0)):
        raise TypeError("interp of points that do not increase cannot be traced")
    left, right = (e if v is None else v for v, e in zip(ends, (y[0], y[-1]), strict=True))
    k = kink(graph, a, tuple(x.tolist()), "interp")
    slopes = [0.0, *(np.diff(y) / np.diff(x)), 0.0]
    start = lookup(graph, k, [x[0], *x])
    rise = graph.mul(lookup(graph, k, slopes), graph.sub(a, start))
    return graph.add(lookup(graph, k, [left, *y[:-1], right]), rise)


def floor(graph: Graph, a: int, what: str = "floor") -> int:
    """Return the node of the largest whole number below a, a linear function of the time.

    It is a constant per state of a kink that has all whole numbers of the run as its breaks.
    """
    if graph.value(a) is not None:
        return graph.const(math.floor(graph.value(a)))
    line = _line(graph, a)
    if line is None:
        raise TypeError(
            f"{what} of what is no linear function of the time cannot be traced; write its jumps "
            "with xp.where"
        )
    first, last = (line[0] * t + line[1] for t in graph.times)
    low = math.floor(min(first, last))
    count = math.ceil(max(first, last)) - low
    if count > MOST_JUMPS:
        raise TypeError(f"{what} with {count} jumps in the run: up to {MOST_JUMPS} are traced")
    k = kink(graph, a, tuple(float(low + j) for j in range(1, count + 1)), what)
    return lookup(graph, k, [low + j for j in range(count + 1)])


def remainder(graph: Graph, a: int, b: int) -> int:
    """Return the node of a - b floor(a / b)."""
    return graph.sub(a, graph.mul(b, floor(graph, graph.div(a, b), "remainder")))


def _line(graph, a) -> tuple[float, float] | None:
    """Return (c, d) of a node that is c t + d with constants; None of any other."""
    op, u, v, c, d = graph.nodes[a]
    if op == CONST or a == graph.n:
        return (0.0, c) if op == CONST else (1.0, 0.0)
    first = _line(graph, u) if op in (AFFINE, ADD, SUB, MUL, DIV) else None
    second = _line(graph, v) if op in (ADD, SUB, MUL, DIV) else (0.0, 0.0)
    if first is None or second is None:
        return None
    if op == AFFINE:
        return c * first[0], c * first[1] + d
    if op in (ADD, SUB):
        sign = 1.0 if op == ADD else -1.0
        return first[0] + sign * second[0], first[1] + sign * second[1]
    if op == MUL and first[0] == 0.0:
        first, second = second, first
    if second[0] != 0.0:
        return None
    factor = second[1] if op == MUL else 1.0 / second[1]
    return first[0] * factor, first[1] * factor


def watches(graph: Graph, k: int) -> tuple[int, int]:
    """Return the nodes that fall through zero where the state of kink k falls, and where it rises.

    Of a kink with one break both are the first; the second is -1 then.
    """
    node, breaks, _ = graph.kinks[k]
    if len(breaks) == 1:
        distance = graph.sub(node, graph.const(breaks[0]))
        return graph.mul(lookup(graph, k, [-1.0, 1.0]), distance), -1
    below = [0.0, *(1.0 for _ in breaks)]
    above = [*(1.0 for _ in breaks), 0.0]
    lower = graph.sub(
        graph.mul(lookup(graph, k, below), node), lookup(graph, k, [-1.0, *breaks])
    )
    upper = graph.sub(
        lookup(graph, k, [*breaks, 1.0]), graph.mul(lookup(graph, k, above), node)
    )
    return lower, upper


def kinks_needed(graph: Graph, needed: list[int], rows) -> list[int]:
    """Return the kinks that nodes depend on, those of the arguments of kinks included.

    needed: the nodes. rows: returns the nodes that a list of nodes needs.
    """
    found = set()
    stack = list(needed)
    while stack:
        new = {int(graph.nodes[i][3]) for i in rows(stack) if graph.nodes[i][0] in (LOOKUP, SELECT)}
        stack = [graph.kinks[k].node for k in new - found]
        found |= new
    return sorted(found)
