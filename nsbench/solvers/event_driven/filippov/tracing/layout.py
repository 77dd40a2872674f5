"""Lay out a traced graph as arrays: the operations that each list of outputs needs, in order."""

from __future__ import annotations

import numpy as np

from nsbench.solvers.event_driven.filippov.kernels.loop_state import Kinks, Programs
from nsbench.solvers.event_driven.filippov.kernels.opcodes import AFFINE, CONST, PAIRS
from nsbench.solvers.event_driven.filippov.tracing.graph import LOOKUP, SELECT, Graph

ROW = 1  # columns of a change of an operation: its row a, or its constant c
NUMBER = 0


def lay_out(graph: Graph, outputs: list[list[int]]) -> Programs:
    """Lay out one program for each list of output nodes (-1: no output there; all of one length).

    The first n outputs of each are the leading ones (see Programs). Operations that depend on the
    state of a kink are laid out for its state 0.
    """
    ops = []
    outs = []
    first = []
    changes = [[] for _ in graph.kinks]
    for wanted in outputs:
        lead = nodes_needed(graph, wanted[: graph.n])
        order = lead + sorted(set(nodes_needed(graph, wanted)).difference(lead))
        rows = {i: i for i in range(graph.n + 1)} | {
            i: graph.n + 1 + k for k, i in enumerate(order)
        }
        first.append([len(ops), len(ops) + len(lead), len(ops) + len(order)])
        for i in order:
            op, a, b, c, d = graph.nodes[i]
            if op == SELECT:
                changes[int(c)].append((len(ops), ROW, [rows[a], rows[b]]))
                ops.append((AFFINE, rows[a], 0, 1.0, 0.0))
            elif op == LOOKUP:
                values = graph.tables[int(d)]
                changes[int(c)].append((len(ops), NUMBER, values))
                ops.append((CONST, 0, 0, values[0], 0.0))
            else:
                ops.append((op, rows.get(a, 0), rows.get(b, 0), c, d))
        outs.append([rows[i] if i >= 0 else -1 for i in wanted])
    first = np.array(first, np.int64)
    return Programs(
        np.array([o[:3] for o in ops], np.int64).reshape(-1, 3),
        np.array([o[3:] for o in ops], float).reshape(-1, 2),
        first,
        np.array(outs, np.int64),
        graph.n + 1 + int((first[:, 2] - first[:, 0]).max(initial=0)),
        _lay_out_kinks(graph, changes),
    )


def _lay_out_kinks(graph, changes) -> Kinks:
    """Lay out the kinks; changes: for each (operation, column, entries by state) that depend on
    it."""
    spans = []
    breaks = []
    patches = []
    entries = []
    for kink, own in zip(graph.kinks, changes, strict=True):
        spans.append((len(breaks), len(kink.breaks), len(patches), len(own)))
        breaks += kink.breaks
        for operation, column, values in own:
            patches.append((operation, column, len(entries)))
            entries += values
    return Kinks(
        np.zeros(len(spans), np.int64),
        np.array(spans, np.int64).reshape(-1, 4),
        np.array(breaks, float),
        np.array(patches, np.int64).reshape(-1, 3),
        np.array(entries, float),
    )


def nodes_needed(graph: Graph, wanted: list[int]) -> list[int]:
    """Return the operations that the nodes `wanted` need, in order."""
    seconds = set(PAIRS.values())
    needed = set()
    stack = [i for i in wanted if i >= 0]
    while stack:
        i = stack.pop()
        if i in needed or i <= graph.n:
            continue
        op, a, b, _, _ = graph.nodes[i]
        needed.add(i)
        stack += [r for r in (a, b) if r >= 0]
        if op in PAIRS:
            stack.append(i + 1)
        elif op in seconds:
            stack.append(i - 1)
    return sorted(needed)
