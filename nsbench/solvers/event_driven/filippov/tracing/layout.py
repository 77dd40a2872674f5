"""Tapes in arrays: for each of several lists of outputs, the operations that make them, in
order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.solvers.event_driven.filippov.kernels.opcodes import PAIRS
from nsbench.solvers.event_driven.filippov.tracing.graph import Graph


@dataclass(frozen=True)
class Programs:
    """ops (e, 3): op, a, b and nums (e, 2): c, d of the operations of all programs in a row.

    Program m has those of first[m, 0] : first[m, 2]; those up to first[m, 1] make its leading
    outputs, the others the rest.
    Operation e of program m makes row n + 1 + e - first[m, 0]; outs[m, j] is the row of its output
    j, -1 for none.
    rows: the largest number of rows.
    """

    ops: np.ndarray
    nums: np.ndarray
    first: np.ndarray
    outs: np.ndarray
    rows: int


def lay_out(graph: Graph, outputs: list[list[int]]) -> Programs:
    """One program for each list of nodes (-1: no output there; all of one length), of which the
    first n lead."""
    ops = []
    outs = []
    first = []
    for wanted in outputs:
        lead = _needed(graph, wanted[: graph.n])
        order = lead + sorted(set(_needed(graph, wanted)).difference(lead))
        rows = {i: i for i in range(graph.n + 1)} | {
            i: graph.n + 1 + k for k, i in enumerate(order)
        }
        first.append([len(ops), len(ops) + len(lead), len(ops) + len(order)])
        ops += [
            (op, rows.get(a, 0), rows.get(b, 0), c, d)
            for op, a, b, c, d in (graph.nodes[i] for i in order)
        ]
        outs.append([rows[i] if i >= 0 else -1 for i in wanted])
    first = np.array(first, np.int64)
    return Programs(
        np.array([o[:3] for o in ops], np.int64).reshape(-1, 3),
        np.array([o[3:] for o in ops], float).reshape(-1, 2),
        first,
        np.array(outs, np.int64),
        graph.n + 1 + int((first[:, 2] - first[:, 0]).max(initial=0)),
    )


def _needed(graph, wanted):
    """The operations that these nodes need, in order."""
    seconds = set(PAIRS.values())
    keep = set()
    stack = [i for i in wanted if i >= 0]
    while stack:
        i = stack.pop()
        if i in keep or i <= graph.n:
            continue
        op, a, b, _, _ = graph.nodes[i]
        keep.add(i)
        stack += [r for r in (a, b) if r >= 0]
        if op in PAIRS:
            stack.append(i + 1)
        elif op in seconds:
            stack.append(i - 1)
    return sorted(keep)
