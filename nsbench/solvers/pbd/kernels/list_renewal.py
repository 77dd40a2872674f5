"""Renew the list of candidates of cell_loop, and select the active ones.

The list (cell_storage) holds what can become active while no particle is farther than skin / 2 from
where it was built; the active candidates (active_candidates) are those of it that can while none is
farther than a smaller skin / 2 from where they were selected.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from nsbench.compilation.decorators import fused_kernel, inner_kernel
from nsbench.linalg.max_norm import largest
from nsbench.solvers.pbd.kernels.active_candidates import (
    inner_skin,
    restore_impulses,
    select_active,
)
from nsbench.solvers.pbd.kernels.cell_search import near_rows
from nsbench.solvers.pbd.kernels.cell_storage import (
    CandidateLists,
    active_candidates,
    no_impulses,
    rebuild,
)
from nsbench.solvers.pbd.kernels.cell_sweep import drift, farthest, sweep_stored
from nsbench.solvers.pbd.kernels.skin_control import (
    HALF,
    SkinControl,
    Skins,
    adapt_to_pace,
    with_age,
)

if TYPE_CHECKING:
    from nsbench.solvers.pbd.kernels.cell_storage import CellScene, CellState

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


class Pause(NamedTuple):
    """Where an interval of equal steps has got to.

    step: how many are done; of the next one, unless that is all, the drift is done, and `sweep`
    sweeps, and the active candidates are to be selected or, if is_selected, have been. time: at the
    start of that step. far: largest squared displacement since the selection before; NaN where the
    drift is not finite. attempts: sweeps of the step that were undone. work: projections done.
    tied: whether centres coincided. control, skins: adapted.
    """

    step: int
    time: float
    sweep: int
    far: float
    attempts: int
    work: int
    tied: bool
    is_selected: bool
    control: SkinControl
    skins: Skins


@fused_kernel
def next_interval(at: Pause) -> Pause:
    """Return the pause before the first step of the next interval."""
    zero = np.int64(0)
    return Pause(zero, at.time, zero, 0.0, zero, at.work, at.tied, False, at.control, at.skins)


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


@inner_kernel
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
    near = np.empty(scene.rows.inv2.size if scene.moving else 0, np.int32)
    for e in range(near.size):
        near[e] = e
    beyond = 0.0  # from the first radius on: the mean of equal ones is theirs to the last digit
    for r in scene.r:
        beyond += r - scene.r[0]
    least = max(reach, 1e-8 * largest(x))
    zero = np.int64(0)
    return (
        CandidateLists(arrays, no_impulses(), scene.r, near),
        ListState(zero, zero, zero, zero, False, n * n),
        Skins(least, 0.3 * least, 0.0, 0.0),
        SkinControl(least, scene.r[0] + beyond / n, 0.15, 0.0, np.inf, zero, zero),
    )


@inner_kernel
def reselect(scene, state, lists, counts, at) -> tuple[CandidateLists, ListState, Pause]:
    """Select the active candidates at the positions y, with a skin that suits the pace.

    Returns lists, counts (count -1 where the list gets too long), and the pause to go on from.
    """
    control = at.control
    if at.attempts == 0:
        control = adapt_to_pace(control, at.far, counts.rebuilds)
    width = max(control.widened, inner_skin(control.pace, control.radius, control.least))
    skins = Skins(at.skins.pairs, width, at.skins.rows, at.skins.certified)
    lists, counts, skins = refresh_candidates(scene, control.least, state, lists, counts, skins)
    at = Pause(
        at.step,
        at.time,
        at.sweep,
        at.far,
        at.attempts,
        at.work,
        at.tied,
        True,
        with_age(control, 0),
        skins,
    )
    return lists, counts, at


@fused_kernel
def undo_sweep(
    z: np.ndarray,
    scene: CellScene,
    state: CellState,
    lists: CandidateLists,
    h: float,
    is_first: bool,
    logged: int,
) -> None:
    """Take back positions and impulses of a sweep, the first one of its step or a later one.

    z (n dim,): positions before the step, by label; logged: impulses that the sweep changed.
    """
    if is_first:
        drift(z, state.y, state.active_base, state.velocity, state.label, h, scene.dim)
    else:
        state.y[:] = state.sweep_start
    if scene.record:
        mu = lists.arrays.active_mu
        for e in range(logged):
            mu[lists.arrays.log_at[e]] = lists.arrays.log_mu[e]


@fused_kernel
def sweep_active(
    scene: CellScene, state: CellState, lists: CandidateLists, active: int, certified: float
) -> tuple[int, bool, bool]:
    """Sweep over the active candidates; returns as cell_sweep.sweep_stored."""
    arrays = lists.arrays
    return sweep_stored(
        active_candidates(arrays, active),
        state.y,
        state.active_base,
        lists.radii,
        scene.dim,
        scene.rows,
        scene.b,
        (HALF * certified) ** 2,
        arrays.log_at,
        arrays.log_mu,
        scene.record,
    )
