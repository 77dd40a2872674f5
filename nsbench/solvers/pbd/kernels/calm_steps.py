"""The steps of cell_loop between two selections of the active candidates.

All that such a step needs is fixed. It stands in a function of its own because numba counts
references to every array that a loop binds anew, at each turn: with the lists of candidates among
them that took as long as the steps.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from nsbench.compilation.borrowed_arrays import borrowed
from nsbench.compilation.decorators import fused_kernel, inner_kernel
from nsbench.solvers.pbd.kernels.cell_storage import active_candidates
from nsbench.solvers.pbd.kernels.cell_sweep import drift, farthest, settle, sweep_stored
from nsbench.solvers.pbd.kernels.skin_control import (
    HALF,
    SkinControl,
    Skins,
    adapt_after_step,
    adapt_to_undone_sweep,
    needs_selection,
    with_age,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from nsbench.solvers.pbd.kernels.cell_storage import CandidateLists, CellScene, CellState


class Pause(NamedTuple):
    """Where an interval of equal steps has got to.

    step: how many are done; of the next one, unless that is all, the drift is done, and `sweep`
    sweeps; then the active candidates must be selected anew. time: at the start of that step. far:
    largest squared displacement since they were selected; NaN where the drift is not finite.
    attempts: how often that sweep was undone. work: projections done. tied: whether centres
    coincided. control, skins: adapted.
    """

    step: int
    time: float
    sweep: int
    far: float
    attempts: int
    work: int
    tied: bool
    control: SkinControl
    skins: Skins


@inner_kernel
def at_step(at: Pause, step: int) -> Pause:
    """Return the pause with the number of steps done set."""
    return Pause(
        step,
        at.time,
        at.sweep,
        at.far,
        at.attempts,
        at.work,
        at.tied,
        at.control,
        at.skins,
    )


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


@inner_kernel
def calm_steps(
    f: Callable,
    b_of: Callable,
    begin: float,
    end: float,
    substeps: int,
    sweeps: int,
    z: np.ndarray,
    scene: CellScene,
    state: CellState,
    lists: CandidateLists,
    active: int,
    rebuilds: int,
    at: Pause,
) -> Pause:
    """Do the steps from at.step on, as far as they need no new selection, and return where.

    begin, end, substeps: the interval and its steps; z (n dim,): positions before the step, by
    label, overwritten by those after the last one that was done; active: candidates that are
    active; rebuilds: lists built. Other arguments as in cell_loop.march.
    """
    scene = borrowed(scene)
    state = borrowed(state)
    lists = borrowed(lists)
    y = state.y
    base = state.active_base
    label = state.label
    dim = scene.dim
    z = borrowed(z)
    h = (end - begin) / substeps
    control = at.control
    skins = at.skins
    work = at.work
    tied = at.tied
    for s in range(at.step, substeps):
        now = begin + s * h
        f(now, z, state.velocity)
        far = drift(z, y, base, state.velocity, label, h, dim)
        if not far >= 0.0:
            return Pause(s, now, 0, far, 0, work, tied, control, skins)
        if scene.moving:
            b_of(end if s + 1 == substeps else begin + (s + 1) * h, scene.b)
        control = with_age(control, control.age + 1)
        for u in range(sweeps):
            if u > 0:
                far = farthest(y, base, dim, label.size)
                state.sweep_start[:] = y
            if needs_selection(far, 0, rebuilds, control, skins.certified):
                return Pause(s, now, u, far, 0, work, tied, control, skins)
            done, coincide, broken = sweep_active(scene, state, lists, active, skins.certified)
            if broken:
                undo_sweep(z, scene, state, lists, h, u == 0, done)
                control = adapt_to_undone_sweep(control, skins.active)
                return Pause(s, now, u, far, 1, work, tied, control, skins)
            work += done
            tied = tied or coincide
        control, skins = adapt_after_step(control, skins, 0)
        settle(z, y, state.velocity, state.reaction, label, h, dim)
    return Pause(substeps, end, 0, 0.0, 0, work, tied, control, skins)
