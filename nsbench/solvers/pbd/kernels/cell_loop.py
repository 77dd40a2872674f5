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

from typing import TYPE_CHECKING

import numpy as np

from nsbench.compilation.borrowed_arrays import borrowed
from nsbench.compilation.decorators import inner_kernel, njit
from nsbench.solvers.common.kernels.step_code import StepCode
from nsbench.solvers.pbd.kernels.cell_records import end_sample, loop_result
from nsbench.solvers.pbd.kernels.cell_storage import CellState
from nsbench.solvers.pbd.kernels.cell_sweep import drift, farthest, settle
from nsbench.solvers.pbd.kernels.list_renewal import (
    Pause,
    initialise,
    restless_step,
    sweep_active,
    undo_sweep,
)
from nsbench.solvers.pbd.kernels.loop_result import LoopResult
from nsbench.solvers.pbd.kernels.skin_control import (
    adapt_after_step,
    adapt_to_undone_sweep,
    needs_selection,
    with_age,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from nsbench.solvers.pbd.kernels.cell_storage import CandidateLists, CellScene


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
