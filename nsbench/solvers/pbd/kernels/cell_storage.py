"""Arrays of hard particles stored cell by cell, and the list of candidates of a sweep among them.

Storage: particle s of the store is the one with label `label[s]`. It is sorted by cells whenever
the list is rebuilt, so what is near in space is near in memory. The order of the sweep is defined
by labels alone (constraint_order), so the storage changes no bit of a result.
Candidates: pairs (i, j) of the store, and rows of A on one particle, (i, -1 - row).
"""

from typing import NamedTuple

import numpy as np

from nsbench.compilation.decorators import inner_kernel
from nsbench.dynamics.contacts.kernels.constraint_order import CELL, sweep_key
from nsbench.dynamics.contacts.kernels.contact_arrays import AffineRows
from nsbench.linalg.max_norm import largest
from nsbench.solvers.pbd.kernels.cell_search import by_cells, near_pairs, permute
from nsbench.solvers.pbd.kernels.conflict_schedule import schedule


class CellScene(NamedTuple):
    """What does not change during a run, but for the entries of b where walls move.

    rows, b: affine rows and their constants. r: radii by label, (n,), or (1,) if all are alike.
    ranks: numbers by label that order the pairs (order CELL), else empty. families (k, 2): the hard
    family, then each family of rows with its first row. dim: of a particle. moving: whether b
    depends on time. order, seed: of the sweep (constraint_order). record: whether impulses are
    recorded (a run without measures what that costs).
    """

    rows: AffineRows
    b: np.ndarray
    r: np.ndarray
    ranks: np.ndarray
    families: np.ndarray
    dim: int
    moving: bool
    order: int
    seed: int
    record: bool


class CellState(NamedTuple):
    """The particles of a run; vectors (n dim,) in the order of the store, but velocity by label.

    y: positions. reaction: its integral. list_base: y when the list was built. active_base: y when
    the active candidates were selected; a work array while the list is built. velocity: the drift.
    sweep_start: y before a sweep that is not the first of its step. label, store (n,): label by
    place, place by label. cell_row (n,): row of cells. ends (n + 1,): work array of the schedule.
    """

    y: np.ndarray
    reaction: np.ndarray
    list_base: np.ndarray
    active_base: np.ndarray
    velocity: np.ndarray
    sweep_start: np.ndarray
    label: np.ndarray
    store: np.ndarray
    cell_row: np.ndarray
    ends: np.ndarray


class PairImpulses(NamedTuple):
    """Impulses mu (m,) of pairs i, j (m,) of particles, j < 0: of row -1 - j on particle i."""

    i: np.ndarray
    j: np.ndarray
    mu: np.ndarray


class CandidateArrays(NamedTuple):
    """Arrays for m candidates; some serve twice, for what is not used at once.

    pairs (2 m,): candidates in the order of execution, i before j | queues of the schedule.
    successors (2 m,): the impulses (as float64) | next constraint at either particle.
    active_pairs (2 m,): active candidates | while the list is built, the pairs as they were found.
    log_at: active candidates whose impulse changed | place: in the order of execution.
    need: how many constraints one waits for. active_mu: impulses of the active ones | keys.
    log_mu: impulses before they changed. active_at: places of the active ones in the list.
    """

    pairs: np.ndarray
    successors: np.ndarray
    active_pairs: np.ndarray
    log_at: np.ndarray
    need: np.ndarray
    active_mu: np.ndarray
    log_mu: np.ndarray
    active_at: np.ndarray


class CandidateLists(NamedTuple):
    """The list in use: its arrays, and what belongs to the positions at which it was built.

    expired: impulses, by label, of candidates that left the list since the last sample. radii: in
    the order of the store, or (1,). near_rows: rows within the cutoff of rows.
    """

    arrays: CandidateArrays
    expired: PairImpulses
    radii: np.ndarray
    near_rows: np.ndarray


@inner_kernel
def candidate_arrays(m: int) -> CandidateArrays:
    """Return work arrays for m candidates; from numpy (py_func) they lie on large pages."""
    return CandidateArrays(
        np.empty(2 * m, np.int32),
        np.empty(2 * m, np.int32),
        np.empty(2 * m, np.int32),
        np.empty(m, np.int32),
        np.empty(m, np.int8),
        np.empty(m),
        np.empty(m),
        np.empty(m, np.int32),
    )


@inner_kernel
def listed(arrays: CandidateArrays, m: int) -> PairImpulses:
    """Return the first m candidates with their impulses."""
    half = arrays.log_at.size
    return PairImpulses(
        arrays.pairs[:m], arrays.pairs[half : half + m], arrays.successors.view(np.float64)[:m]
    )


@inner_kernel
def active_candidates(arrays: CandidateArrays, m: int) -> PairImpulses:
    """Return the first m active candidates with their impulses."""
    half = arrays.log_at.size
    return PairImpulses(
        arrays.active_pairs[:m], arrays.active_pairs[half : half + m], arrays.active_mu[:m]
    )


@inner_kernel
def no_impulses() -> PairImpulses:
    """Return an empty list of impulses."""
    return PairImpulses(np.empty(0, np.int32), np.empty(0, np.int32), np.empty(0))


@inner_kernel
def fill_keys(
    i: np.ndarray, j: np.ndarray, label: np.ndarray, scene: CellScene, keys: np.ndarray
) -> None:
    """Fill keys (m,) with the keys of the candidates i, j (m,) in the order of the sweep."""
    families = scene.families
    for c in range(i.size):
        if j[c] < 0:
            q = -1 - j[c]
            u = families.shape[0] - 1
            while families[u, 1] > q:
                u -= 1
            keys[c] = sweep_key(scene.order, scene.seed, families[u, 0], q - families[u, 1], 0)
        else:
            a = np.int64(label[i[c]])
            b = np.int64(label[j[c]])
            if scene.order == CELL:
                a = scene.ranks[a]
                b = scene.ranks[b]
            keys[c] = sweep_key(scene.order, scene.seed, families[0, 0], min(a, b), max(a, b))


@inner_kernel
def by_label(candidates: PairImpulses, label: np.ndarray, expired: PairImpulses) -> PairImpulses:
    """Return the impulses that are not zero by label, those that had expired before among them.

    label (n,): of each place of the store.
    """
    i, j, mu = candidates
    # two passes: count, then copy
    m = expired.mu.size
    for c in range(mu.size):
        m += mu[c] != 0.0
    out = PairImpulses(np.empty(m, np.int32), np.empty(m, np.int32), np.empty(m))
    m = expired.mu.size
    out.i[:m] = expired.i
    out.j[:m] = expired.j
    out.mu[:m] = expired.mu
    for c in range(mu.size):
        if mu[c] != 0.0:
            out.i[m] = label[i[c]]
            out.j[m] = label[j[c]] if j[c] >= 0 else j[c]
            out.mu[m] = mu[c]
            m += 1
    return out


@inner_kernel
def transfer_impulses(
    new: PairImpulses, old: PairImpulses, state: CellState, head: np.ndarray
) -> PairImpulses:
    """Fill the impulses of the new candidates from the old ones (by label, changed).

    head (n,): work array. Returns those that are left, by label: of pairs no longer listed.
    """
    # per particle a linked list of the old pairs, kept at the later place; a row at its only one
    head[:] = -1
    after = np.empty(old.mu.size, np.int32)
    left = old.mu.size
    for e in range(old.mu.size):
        a = state.store[old.i[e]]
        b = state.store[old.j[e]] if old.j[e] >= 0 else old.j[e]
        if b > a:
            a, b = b, a
        old.i[e] = a
        old.j[e] = b
        after[e] = head[a]
        head[a] = e
    # each new candidate looks for itself among the old pairs of its later particle
    for c in range(new.i.size):
        a = max(new.i[c], new.j[c])
        b = min(new.i[c], new.j[c])
        e = head[a]
        while e >= 0 and old.j[e] != b:
            e = after[e]
        new.mu[c] = 0.0
        if e >= 0:
            new.mu[c] = old.mu[e]
            old.mu[e] = 0.0
            left -= 1
    out = PairImpulses(np.empty(left, np.int32), np.empty(left, np.int32), np.empty(left))
    m = 0
    for e in range(old.mu.size):
        if old.mu[e] != 0.0:
            out.i[m] = state.label[old.i[e]]
            out.j[m] = state.label[old.j[e]] if old.j[e] >= 0 else old.j[e]
            out.mu[m] = old.mu[e]
            m += 1
    return out


@inner_kernel
def put(
    i: np.ndarray, j: np.ndarray, place: np.ndarray, label: np.ndarray, a: np.ndarray, b: np.ndarray
) -> None:
    """Write candidates i, j (m,) to their places (m,) in a, b, the lower label of a pair first.

    label (n,): of each place of the store.
    """
    for c in range(i.size):
        swap = j[c] >= 0 and label[i[c]] > label[j[c]]
        a[place[c]] = j[c] if swap else i[c]
        b[place[c]] = i[c] if swap else j[c]


@inner_kernel
def sort_store(scene: CellScene, state: CellState, skin: float) -> tuple[np.ndarray, np.ndarray]:
    """Sort the store by cells of the positions y, as wide as the cutoff; list_base becomes y.

    Returns what near_pairs needs: the first particle of each cell, and the numbers of cells (3,).
    """
    n = state.label.size
    order = state.active_base.view(np.int32)[:n]
    cell = state.active_base.view(np.int32)[n : 2 * n]
    width = 2.0 * largest(scene.r) + skin
    first, num = by_cells(state.y, scene.dim, width, cell, order, state.cell_row)
    permute(state.y, order, scene.dim, state.list_base)
    permute(state.reaction, order, scene.dim, state.list_base)
    state.list_base[:] = state.y
    for s in range(n):
        cell[s] = state.label[order[s]]
    state.label[:] = cell
    for s in range(n):
        state.store[state.label[s]] = s
    return first, num


@inner_kernel
def order_candidates(
    scene: CellScene, state: CellState, arrays: CandidateArrays, pairs: int, which: np.ndarray
) -> int:
    """Bring the pairs found and the rows `which` to their order of execution; returns their number.

    pairs: number of pairs in active_pairs, behind which the rows are written.
    """
    half = arrays.log_at.size
    i = arrays.active_pairs[:half]
    j = arrays.active_pairs[half:]
    m = pairs + which.size
    for e in range(which.size):
        i[pairs + e] = state.store[scene.rows.cols[scene.rows.ptr[which[e]]] // scene.dim]
        j[pairs + e] = -1 - which[e]
    keys = arrays.active_mu.view(np.uint64)[:m]
    place = arrays.log_at[:m]
    fill_keys(i[:m], j[:m], state.label, scene, keys)
    schedule(
        i[:m],
        j[:m],
        keys,
        state.cell_row,
        state.ends,
        arrays.pairs[: 2 * m],
        arrays.successors[: 2 * m],
        arrays.need[:m],
        place,
    )
    put(i[:m], j[:m], place, state.label, arrays.pairs[:half], arrays.pairs[half:])
    return m


@inner_kernel
def rebuild(
    scene: CellScene,
    state: CellState,
    lists: CandidateLists,
    count: int,
    skin: float,
    which: np.ndarray,
    max_pairs: int,
) -> tuple[CandidateLists, int, int]:
    """Sort the store at the positions y, and list the candidates there with their impulses.

    count: candidates of the old list; skin: of the new one; which: the rows listed. Returns the new
    lists (with longer arrays if need be), the number of candidates, and the number of pairs. The
    number of candidates is -1 if there are more than max_pairs pairs; the lists are then unusable.
    """
    arrays = lists.arrays
    old = by_label(listed(arrays, count), state.label, lists.expired)
    n = state.label.size
    first, num = sort_store(scene, state, skin)
    radii = scene.r if scene.r.size == 1 else scene.r[state.label]
    # search again with longer arrays until all pairs fit
    while True:
        size = arrays.log_at.size
        i = arrays.active_pairs[:size]
        j = arrays.active_pairs[size:]
        pairs = near_pairs(state.y, radii, skin, scene.dim, first, num, i, j)
        if 0 <= pairs <= max_pairs and pairs + which.size <= size:
            break
        if pairs > max_pairs or (pairs < 0 and size > max_pairs + n):
            return lists, np.int64(-1), pairs
        arrays = candidate_arrays(2 * size + which.size)
    # the impulses go on where their candidate is listed again, else they expire
    m = order_candidates(scene, state, arrays, pairs, which)
    head = state.active_base.view(np.int32)[:n]
    expired = transfer_impulses(listed(arrays, m), old, state, head)
    return CandidateLists(arrays, expired, radii, lists.near_rows), m, pairs
