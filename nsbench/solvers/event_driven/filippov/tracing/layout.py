"""Layout of a traced graph: for each of several lists of outputs, the operations that compute them,
in order, as arrays."""

from __future__ import annotations

import numpy as np

from nsbench.solvers.event_driven.filippov.kernels.loop_state import Programs
from nsbench.solvers.event_driven.filippov.kernels.opcodes import PAIRS
from nsbench.solvers.event_driven.filippov.tracing.graph import Graph


def lay_out(graph: Graph, outputs: list[list[int]]) -> Programs:
    """Lay out one program for each list of output nodes (-1: no output there; all of one length).

    The first n outputs of each are the leading ones (see Programs).
    """
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
    """Operations that the nodes `wanted` need, in order."""
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
