"""Write the samples of cell_loop: reactions by label, and impulses as records."""

from __future__ import annotations

import numpy as np

from nsbench.compilation.borrowed_arrays import borrowed
from nsbench.compilation.decorators import inner_kernel
from nsbench.solvers.pbd.kernels.active_candidates import restore_impulses
from nsbench.solvers.pbd.kernels.cell_storage import CandidateLists, listed, no_impulses
from nsbench.solvers.pbd.kernels.loop_result import LoopResult


@inner_kernel
def unpack(values, label, dim, out) -> None:
    """Write values (n, dim), in the order of the store, to out by label."""
    for s in range(label.size):
        for c in range(dim):
            out[label[s] * dim + c] = values[s * dim + c]


@inner_kernel
def flush(
    k, pairs, expired, label, families, ids, values, count
) -> tuple[np.ndarray, np.ndarray, int]:
    """Move all impulses to the records (sample, family, i, j) and clear them.

    pairs, expired: PairImpulses by place in the store and by label. Returns the records,
    longer ones if need be, and their number.
    """
    i, j, mu = pairs
    need = expired.mu.size
    for c in range(mu.size):
        need += mu[c] != 0.0
    if count + need > values.size:
        room = max(need, values.size // 2)
        ids = np.concatenate((ids[:count], np.empty((room, 4), np.int32)))
        values = np.concatenate((values[:count], np.empty(room)))
    for c in range(mu.size + expired.mu.size):
        if c < mu.size:
            if mu[c] == 0.0:
                continue
            a = label[i[c]]
            q = label[j[c]] if j[c] >= 0 else j[c]
            m = mu[c]
            mu[c] = 0.0
        else:
            a = expired.i[c - mu.size]
            q = expired.j[c - mu.size]
            m = expired.mu[c - mu.size]
        ids[count, 0] = k
        values[count] = m
        if q >= 0:
            ids[count, 1], ids[count, 2], ids[count, 3] = families[0, 0], min(a, q), max(a, q)
        else:
            q = -1 - q
            u = families.shape[0] - 1
            while families[u, 1] > q:
                u -= 1
            ids[count, 1] = families[u, 0]
            ids[count, 2] = q - families[u, 1]
            ids[count, 3] = -1
        count += 1
    return ids, values, count


@inner_kernel
def end_sample(k, scene, state, lists, counts, records, reaction):
    """Store the reaction (n,) of sample k, and move the impulses since the last one to the records.

    records: (ids, values, count). Returns the records, and the lists without the impulses that
    pairs had before they left the list.
    """
    lent = borrowed(lists)
    label = borrowed(state.label)
    unpack(borrowed(state.reaction), label, scene.dim, reaction)
    if scene.record:
        ids, values, count = records
        restore_impulses(lent.arrays, counts.active)
        lent.arrays.active_mu[: counts.active] = 0.0
        pairs = listed(lent.arrays, counts.count)
        records = flush(k, pairs, lent.expired, label, scene.families, ids, values, count)
    if lent.expired.mu.size > 0:
        lists = CandidateLists(lists.arrays, no_impulses(), lists.radii, lists.near_rows)
    return records, lists


@inner_kernel
def loop_result(X, R, records, code, at, counts):
    """Return the LoopResult of a run that ended at the Pause `at`; counts: ListState."""
    ids, values, count = records
    return LoopResult(
        X,
        R,
        ids[:count],
        values[:count],
        at.work,
        code,
        at.time,
        counts.rebuilds,
        counts.peak_pairs,
    )
