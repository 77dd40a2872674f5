"""Time loop of PBD for one family of hard particles stored by cells, and rows on single particles.

It does the sweep of neighbor_loop bit for bit, and faster. The list of candidates (cell_storage)
holds what can become active while no particle is farther than skin / 2 from where the list was
built (a Verlet list); the sweep runs over those of them (active_candidates) that can while none is
farther than a smaller skin / 2 from where they were selected. That certificate is checked after the
drift for all particles and after every projection for those it moved. Where it fails within a
sweep, the sweep is undone (positions computed anew, impulses from a log), the selection or the list
is renewed at the start of the sweep, wider if it was new already, and the sweep is done again; so
nothing is ever done that the sweep over all constraints would not have done. Where the list would
get too long, the run ends with LIST_OVERFLOW, to be done by neighbor_loop.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nsbench.compilation.borrowed_arrays import borrowed
from nsbench.compilation.decorators import fused_kernel, inner_kernel, njit
from nsbench.solvers.common.kernels.step_code import StepCode
from nsbench.solvers.pbd.kernels.active_candidates import (
    inner_skin,
    restore_impulses,
    select_active,
)
from nsbench.solvers.pbd.kernels.calm_steps import Pause, at_step, calm_steps, sweep_active, undo_sweep
from nsbench.solvers.pbd.kernels.cell_search import near_rows
from nsbench.solvers.pbd.kernels.cell_storage import (
    CandidateLists,
    CellState,
    active_candidates,
    listed,
    no_impulses,
    rebuild,
)
from nsbench.solvers.pbd.kernels.cell_sweep import farthest, settle, sweep_stored
from nsbench.solvers.pbd.kernels.loop_result import LoopResult
from nsbench.solvers.pbd.kernels.skin_control import (
    HALF,
    SkinControl,
    Skins,
    adapt_after_step,
    adapt_to_pace,
    adapt_to_undone_sweep,
    needs_selection,
    with_age,
)

PAIRS_PER_PARTICLE = 11  # allowed in a list, unless the first list has half as many already,
ALL_PAIRS_FIT = 1500  # or there are no more particles: all their pairs take 60 MB
# cutoff of the list of rows over skin / 2: it is renewed that much less often
ROW_LIST_REACH = 16.0
ROUNDING = 2.0002  # displacements of two particles; 2e-4 of the skin is for rounding


class ListState(NamedTuple):
    """Counters of the candidate list.

    count, active: candidates, and active ones. rebuilds: lists built. peak_pairs: most pairs in
    one. is_complete: whether the list holds every pair and row. max_pairs: pairs allowed.
    """

    count: int
    active: int
    rebuilds: int
    peak_pairs: int
    is_complete: bool
    max_pairs: int


@njit(cache=True)
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
def refresh_candidates(
    scene, least, state, lists, counts, skins
) -> tuple[CandidateLists, ListState, Skins]:
    """Select the active candidates at the positions y, from a new list if the old one is used up.

    scene: CellScene; least: smallest skin of a list; state: CellState. Returns lists, counts
    (ListState) and skins; counts.count is -1 where the list gets too long.
    """
    if scene.record:
        restore_impulses(lists.arrays, counts.active)
    n = state.label.size
    gone = np.sqrt(farthest(state.y, state.list_base, scene.dim, n))
    left = skins.pairs - ROUNDING * gone
    # sweeps move particles by more than the list is built for: all of it is selected
    wide = skins.active >= least
    if counts.rebuilds == 0 or (not counts.is_complete and (wide or left < 0.6 * skins.active)):
        lists, counts, skins = renew_list(scene, least, state, lists, counts, skins, gone)
        if counts.count < 0:
            return lists, counts, skins
        left = skins.pairs
    certified = min(skins.active, left)
    if counts.is_complete:
        certified = np.inf if wide else skins.active
    active = select_active(lists.arrays, counts.count, state.y, lists.radii, certified, scene)
    state.active_base[:] = state.y
    return (
        lists,
        ListState(
            counts.count,
            active,
            counts.rebuilds,
            counts.peak_pairs,
            counts.is_complete,
            counts.max_pairs,
        ),
        Skins(skins.pairs, skins.active, skins.rows, certified),
    )


@inner_kernel
def renew_list(
    scene, least, state, lists, counts, skins, gone
) -> tuple[CandidateLists, ListState, Skins]:
    """Build the list of candidates anew at the positions y; arguments as in refresh_candidates.

    gone: largest displacement since the old list was built.
    """
    n = state.label.size
    skin = max(least, skins.active)
    row_skin = skins.rows
    which = lists.near_rows
    if not scene.moving:
        row_skin -= gone
        near = lists.near_rows
        if row_skin < 0.5 * skin:
            row_skin = 0.5 * ROW_LIST_REACH * skin
            near = near_rows(
                state.y, state.store, scene.rows, scene.b, row_skin, scene.dim, near, True
            )
        which = near_rows(
            state.y, state.store, scene.rows, scene.b, 0.5 * skin, scene.dim, near, False
        )
        lists = CandidateLists(lists.arrays, lists.expired, lists.radii, near)
    max_pairs = counts.max_pairs
    lists, count, pairs = rebuild(scene, state, lists, counts.count, skin, which, max_pairs)
    if counts.rebuilds == 0 and n > ALL_PAIRS_FIT:
        max_pairs = max(PAIRS_PER_PARTICLE * n, 2 * pairs)
    rebuilds = counts.rebuilds + (1 if count >= 0 else 0)
    peak = max(counts.peak_pairs, pairs) if count >= 0 else counts.peak_pairs
    is_complete = pairs == n * (n - 1) // 2 and count == pairs + scene.rows.inv2.size
    return (
        lists,
        ListState(count, counts.active, rebuilds, peak, is_complete, max_pairs),
        Skins(skin, skins.active, row_skin, skins.certified),
    )


@njit(cache=True)
def initialise(
    scene, state, arrays, x, reach
) -> tuple[CandidateLists, ListState, Skins, SkinControl]:
    """Set the state to the start x (n dim,) and return lists, counts, skins and control."""
    n = x.size // scene.dim
    state.y[:] = x
    state.list_base[:] = x
    state.active_base[:] = x
    state.reaction[:] = 0.0
    for s in range(n):  # the arrays may have been used before
        state.label[s] = s
        state.store[s] = s
    near = np.arange(scene.rows.inv2.size if scene.moving else 0).astype(np.int32)
    least = max(reach, 1e-8 * np.abs(x).max())
    zero = np.int64(0)
    return (
        CandidateLists(arrays, no_impulses(), scene.r, near),
        ListState(zero, zero, zero, zero, False, n * n),
        Skins(least, 0.3 * least, 0.0, 0.0),
        SkinControl(least, scene.r.mean(), 0.15, 0.0, np.inf, zero, zero),
    )


@njit(cache=True, error_model="numpy")
def reselect(
    scene, state, lists, counts, skins, control, far, attempts
) -> tuple[CandidateLists, ListState, Skins, SkinControl]:
    """Select the active candidates at the positions y, with a skin that suits the pace.

    far: largest squared displacement since the last selection; attempts: sweeps of this step
    undone. Returns lists, counts (count -1 where the list gets too long), skins and control.
    """
    if attempts == 0:
        control = adapt_to_pace(control, far, counts.rebuilds)
    width = max(control.widened, inner_skin(control.pace, control.radius, control.least))
    skins = Skins(skins.pairs, width, skins.rows, skins.certified)
    lists, counts, skins = refresh_candidates(scene, control.least, state, lists, counts, skins)
    return lists, counts, skins, with_age(control, 0)


@njit(cache=True)
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


@njit(cache=True)
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


@inner_kernel
def restless_step(
    z, h, sweeps, scene, state, lists, counts, at
) -> tuple[CandidateLists, ListState, Pause]:
    """Finish a step that needs a selection of the active candidates, from sweep at.sweep on.

    Arguments as in calm_steps. Returns lists, counts (count -1 where the list gets too long) and
    the pause after the step.
    """
    control = at.control
    skins = at.skins
    far = at.far
    attempts = at.attempts
    work = at.work
    tied = at.tied
    for u in range(at.sweep, sweeps):
        if u > 0:
            far = farthest(state.y, state.active_base, scene.dim, state.label.size)
            state.sweep_start[:] = state.y
        # sweep under the certificate: undone, and done again with wider lists, if it fails
        broken = True
        while broken:
            if needs_selection(far, attempts, counts.rebuilds, control, skins.certified):
                lists, counts, skins, control = reselect(
                    scene, state, lists, counts, skins, control, far, attempts
                )
                if counts.count < 0:
                    return lists, counts, at
                if u > 0:
                    state.sweep_start[:] = state.y
            done, coincide, broken = sweep_active(
                scene, state, lists, counts.active, skins.certified
            )
            if broken:
                undo_sweep(z, scene, state, lists, h, u == 0, done)
                control = adapt_to_undone_sweep(control, skins.active)
                attempts += 1
        work += done
        tied = tied or coincide
    control, skins = adapt_after_step(control, skins, attempts)
    settle(z, state.y, state.velocity, state.reaction, state.label, h, scene.dim)
    zero = np.int64(0)  # no literal: one version of the functions it is given to
    return lists, counts, Pause(at.step + 1, at.time, zero, 0.0, zero, work, tied, control, skins)


@njit(cache=True, error_model="numpy")
def march(f, b_of, t, substeps, sweeps, x, reach, scene, state, arrays, X, R) -> LoopResult:
    """Integrate from x and fill X, R (K, n) with states and reactions; returns a LoopResult.

    f, b_of: pointers (t, x, out), (t, out); t (K,), substeps (K - 1,): the grid; sweeps: per step;
    reach: least skin; scene, state, arrays: CellScene, CellState, CandidateArrays.
    """
    lists, counts, skins, control = initialise(scene, state, arrays, x, reach)
    X[0] = x
    R[0] = 0.0
    records = np.empty((0, 4), np.int32), np.empty(0), 0
    zero = np.int64(0)  # no literal: one version of the functions it is given to
    at = Pause(zero, t[0], zero, 0.0, zero, zero, False, control, skins)
    for k in range(t.size - 1):
        m = substeps[k]
        X[k + 1] = X[k]
        z = X[k + 1]
        at = at_step(at, zero)
        while at.step < m:
            at = calm_steps(
                f,
                b_of,
                t[k],
                t[k + 1],
                m,
                sweeps,
                z,
                scene,
                state,
                lists,
                counts.active,
                counts.rebuilds,
                at,
            )
            if at.step == m:
                break
            if not at.far >= 0.0:
                X[k + 1 :] = np.nan
                R[k + 1 :] = np.nan
                return loop_result(X, R, records, StepCode.NAN, at, counts)
            h = (t[k + 1] - t[k]) / m
            lists, counts, at = restless_step(z, h, sweeps, scene, state, lists, counts, at)
            if counts.count < 0:
                return loop_result(X, R, records, StepCode.LIST_OVERFLOW, at, counts)
        records, lists = end_sample(k + 1, scene, state, lists, counts, records, R[k + 1])
    return loop_result(X, R, records, StepCode.TIED if at.tied else StepCode.OK, at, counts)


def cell_state(n: int, size: int) -> CellState:
    """Return the state of n particles with `size` coordinates in all; it is filled by march."""
    return CellState(
        *np.empty((6, size)),
        np.empty(n, np.int32),
        np.empty(n, np.int32),
        np.empty(n, np.int32),
        np.empty(n + 1, np.int32),
    )


def first_size(n: int) -> int:
    """Return the number of candidates that the first arrays for n particles can hold."""
    return 8 * n + 64
