"""Prove links infeasible: two anchors lie farther apart than the shortest chain of links reaches.

The check infeasible_constraints asks for it.
"""

from __future__ import annotations

import functools

import numpy as np

from nsbench.case import Case
from nsbench.case.scale import size_text, time_text
from nsbench.dynamics.contacts.constraint_set import ANCHOR, PAIR
from nsbench.dynamics.contacts.tolerances import HARMLESS, PRINTED, ROUNDED, scene_of

MISSED = 1e-9  # of the length of a chain: what it may be too short by
ENDS = 200  # anchored links of one chain between which the ways are looked at


def links_too_short(case: Case, t: float) -> str | None:
    """Which two anchors are further apart at t than the links between them let them be; None where
    none are."""
    scene = scene_of(case)
    anchors = None
    for i, j, reach in _chains(case):
        anchors = scene.anchors(t) if anchors is None else anchors
        a = anchors[i]
        b = anchors[j]
        apart = np.sqrt(((a - b) ** 2).sum(-1))
        terms = np.abs(a).max(-1) + np.abs(b).max(-1)
        short = (
            apart
            - (1.0 + MISSED) * reach
            - np.maximum(ROUNDED * terms, np.minimum(PRINTED * terms, HARMLESS * reach))
        )
        k = int(np.argmax(short))
        if short[k] > 0.0:
            return (
                f"The links are too short at t = {time_text(t, 6)}: two anchors are "
                f"{size_text(apart[k], 6)} apart, "
                f"and the links between them "
                f"{size_text(reach[k], 6)} long."
            )
    return None


@functools.lru_cache(maxsize=64)
def _chains(case: Case) -> list[tuple]:
    """By dimension of the links: coordinates of the two anchors (k, dim) and (k, dim) of every way
    there is from one to another, and its length (k,)."""
    scene = scene_of(case)
    near = scene.all_static()
    out = []
    links = near.take(np.isin(near.kind, (PAIR, ANCHOR)) & (near.sign < 0))
    for dim in np.unique(links.dim[links.kind == ANCHOR]):
        of = links.take(links.dim == dim)
        # nodes: particles by their first coordinate, then anchors by theirs
        i, j, reach = _ways(of.p, np.where(of.kind == ANCHOR, case.n + of.q, of.q), of.d, case.n)
        if len(i):
            out.append(
                (
                    (i - case.n)[:, None] + np.arange(dim),
                    (j - case.n)[:, None] + np.arange(dim),
                    reach,
                )
            )
    return out


def _ways(p, q, d, n: int) -> tuple:
    """Two ends, nodes from n on, and the length of the shortest way along edges (p, q) of length d,
    for all that are joined."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components, shortest_path

    order = np.lexsort(
        (d, q, p)
    )  # of several links of one pair the shortest: a sparse array adds them
    order = order[np.append(True, (np.diff(p[order]) != 0) | (np.diff(q[order]) != 0))]
    size = int(max(p.max(), q.max())) + 1
    graph = coo_matrix((d[order], (p[order], q[order])), (size, size)).tocsr()
    _, part = connected_components(graph, directed=False)
    nodes = np.argsort(part, kind="stable")
    found = [(np.empty(0, np.int64),) * 2 + (np.empty(0),)]
    for chain in np.split(nodes, np.flatnonzero(np.diff(part[nodes])) + 1):
        ends = np.flatnonzero(chain >= n)[:ENDS]
        if len(ends) > 1:
            reach = shortest_path(graph[chain][:, chain], directed=False, indices=ends)[:, ends]
            i, j = np.triu_indices(len(ends), 1)
            found.append((chain[ends[i]], chain[ends[j]], reach[i, j]))
    return tuple(np.concatenate(a) for a in zip(*found, strict=True))
