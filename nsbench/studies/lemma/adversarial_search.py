"""Search for orders and gaps that make one sweep leave a large violation: lower bounds.

Simulated annealing over the order and the set of active contacts (see kernels.worst_case), for one
target contact of each kind and several starts, then a check: the gaps and the order found are swept
by nsbench.studies.packings.linear_sweep, and what that leaves is the value returned.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.studies.lemma.kernels.worst_case import (
    anneal,
    ascend_active_set,
    worst_of_order,
)
from nsbench.studies.packings.linear_sweep import sweep

HEAT = np.array([0.1, 1e-3])  # first and last temperature, against violations of about 1
BRIEF = 5  # the first run of each kind of contact is shorter by this factor
PROMISING = 3  # kinds of contacts that are searched at length
SUM = -1  # target of the kernel: the sum of all violations


@dataclass(frozen=True)
class WorstCase:
    """The worst case found: value, order (m,), gaps (m,) before the sweep, the target contact.

    For the sum constant the target is the one contact that is violated before the sweep.
    """

    value: float
    order: np.ndarray
    gaps: np.ndarray
    target: int


@dataclass(frozen=True)
class RowStorage:
    """A without its diagonal by rows: ptr (m + 1,), cols (e,), vals (e,)."""

    ptr: np.ndarray
    cols: np.ndarray
    vals: np.ndarray


def store_rows(gram: np.ndarray) -> RowStorage:
    """Store the off-diagonal entries of A (m, m) by rows."""
    off = (gram != 0.0) & ~np.eye(len(gram), dtype=bool)
    rows, cols = np.nonzero(off)
    ptr = np.r_[0, np.cumsum(np.bincount(rows, minlength=len(gram)))]
    return RowStorage(ptr, cols, gram[rows, cols])


def distinct_contacts(gram: np.ndarray, distance: np.ndarray) -> list[int]:
    """Return one contact of each kind, by the entries of A within each distance from it.

    Contacts that a symmetry maps onto each other are of one kind.
    """
    seen: dict[tuple, int] = {}
    for k in range(len(gram)):
        shells = [np.inf if np.isinf(d) else float(d) for d in np.sort(distance[k])]
        entries = np.round(np.sort(gram[k]), 9)
        strength = [
            np.round(np.sort(np.abs(gram).sum(axis=1)[distance[k] == d]), 6).tolist()
            for d in (1.0, 2.0)
        ]
        seen.setdefault((*shells, *entries, str(strength)), k)
    return sorted(seen.values())


def search_violation(
    gram: np.ndarray, distance: np.ndarray, seed: int, starts: int, steps: int
) -> WorstCase:
    """Search for the order and the gaps g >= -1 with the largest violation left.

    distance (m, m): in the dual graph. starts: annealing runs of `steps` evaluations for each of
    the most promising targets.
    """
    return _search(gram, distance, seed, starts, steps, total=False)


def search_sum(
    gram: np.ndarray, distance: np.ndarray, seed: int, starts: int, steps: int
) -> WorstCase:
    """Search for the order and the one violated contact with the largest sum of violations left."""
    return _search(gram, distance, seed, starts, steps, total=True)


def _search(gram, distance, seed, starts, steps, total):
    """Anneal briefly for every kind of contact, then `starts` times for the most promising ones."""
    rng = np.random.default_rng([seed, len(gram), int(total)])
    rows = store_rows(gram)
    kinds = distinct_contacts(gram, distance)
    brief = max(1, steps // BRIEF)
    found = [_anneal_once(gram, rows, distance, k, rng, brief, total) for k in kinds]
    found.sort(key=lambda f: -f.value)
    for target in [f.target for f in found[:PROMISING]]:
        found += [
            _anneal_once(gram, rows, distance, target, rng, steps, total) for _ in range(starts)
        ]
    return max(found, key=lambda f: f.value)


def _anneal_once(gram, rows, distance, target, rng, steps, total):
    """Anneal once for one target, climb to the next maximum over the gaps, and verify it."""
    u = np.ones(len(gram))
    if total:
        u = (np.arange(len(gram)) == target).astype(float)
    order = _first_order(distance[target], rng, inwards=not total)
    active = np.ones(len(gram), dtype=np.bool_)
    goal = SUM if total else target
    sweep_data = (rows.ptr, rows.cols, rows.vals, u, goal, order, active)
    anneal(*sweep_data, steps, HEAT, int(rng.integers(1 << 62)))
    ascend_active_set(*sweep_data)
    return _verify(gram, u, order, active, target, total)


def _first_order(distance, rng, inwards):
    """Order by distance from the target, ties at random; inwards: the target first of all.

    Inwards, corrections add up on their way to the neighbours of the target, which open it again.
    """
    key = np.where(np.isfinite(distance), distance, 1e9) + 0.5 * rng.random(len(distance))
    key = np.where(distance == 0.0, np.inf, key) if inwards else -key
    return np.argsort(-key, kind="stable").astype(np.int64)


def _verify(gram, u, order, active, target, total):
    """Sweep the gaps of a worst case with plain arithmetic and return it with its own value."""
    gaps = np.zeros(len(gram))
    c = np.zeros(len(gram))
    for k in order:
        q = float(gram[k] @ c)
        gaps[k] = -u[k] if active[k] else max(-u[k], -q)
        c[k] = max(0.0, -(gaps[k] + q))
    left = sweep(gram, order, gaps).violations
    if not total:
        return WorstCase(float(left.max()), order.copy(), gaps, target)
    before = float(np.maximum(-gaps, 0.0).sum())
    value = float(left.sum()) / before if before > 0.0 else 0.0
    return WorstCase(value, order.copy(), gaps, target)


def search_fixed_order(gram: np.ndarray, order: np.ndarray) -> float:
    """Return the largest violation left that coordinate ascent over the gaps finds."""
    rows = store_rows(gram)
    return float(worst_of_order(rows.ptr, rows.cols, rows.vals, np.asarray(order, dtype=np.int64)))
