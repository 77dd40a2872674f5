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
from nsbench.compilation.decorators import fused_kernel, inner_kernel, njit
from nsbench.solvers.common.kernels.step_code import StepCode
from nsbench.solvers.pbd.kernels.cell_records import end_sample, loop_result
from nsbench.solvers.pbd.kernels.cell_storage import CellState
from nsbench.solvers.pbd.kernels.cell_sweep import drift, farthest, settle
from nsbench.solvers.pbd.kernels.list_renewal import (
    Pause,
    initialise,
    next_interval,
    reselect,
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


@fused_kernel
def move_freely(
    f: Callable, now: float, h: float, z: np.ndarray, scene: CellScene, state: CellState
) -> float:
    """Do an Euler step from z without constraints; returns as cell_sweep.drift."""
    f(now, z, state.velocity)
    return drift(z, state.y, state.active_base, state.velocity, state.label, h, scene.dim)


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
    """Do the steps from `at` on for which the selection of active candidates holds.

    All that they need is fixed: numba counts references to every array that a loop binds anew, at
    each turn, and with the lists of candidates among them that took as long as the steps.
    begin, end, substeps: the interval and its steps; z (n dim,): positions before the step, by
    label, overwritten by those after the last one that was done; active: candidates that are
    active; rebuilds: lists built. Other arguments as in march. Returns where it stopped.
    """
    scene, state, lists, z = borrowed((scene, state, lists, z))
    y = state.y
    h = (end - begin) / substeps
    s, _, u, far, attempts, work, tied, resumed, control, skins = at
    while s < substeps:
        now = begin + s * h
        if not resumed:
            far = move_freely(f, now, h, z, scene, state)
            if not far >= 0.0:
                return Pause(s, now, 0, far, 0, work, tied, False, control, skins)
            if scene.moving:
                b_of(end if s + 1 == substeps else begin + (s + 1) * h, scene.b)
            control = with_age(control, control.age + 1)
            u = 0
            attempts = 0
        while u < sweeps:
            if u > 0:
                state.sweep_start[:] = y
                far = farthest(y, state.active_base, scene.dim, state.label.size)
            if not resumed and needs_selection(far, attempts, rebuilds, control, skins.certified):
                return Pause(s, now, u, far, attempts, work, tied, False, control, skins)
            resumed = False
            done, coincide, broken = sweep_active(scene, state, lists, active, skins.certified)
            if broken:
                undo_sweep(z, scene, state, lists, h, u == 0, done)
                control = adapt_to_undone_sweep(control, skins.active)
                return Pause(s, now, u, far, attempts + 1, work, tied, False, control, skins)
            work += done
            tied = tied or coincide
            u += 1
        control, skins = adapt_after_step(control, skins, attempts)
        settle(z, y, state.velocity, state.reaction, state.label, h, scene.dim)
        s += 1
    return Pause(substeps, end, 0, 0.0, 0, work, tied, False, control, skins)


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
    at = Pause(zero, t[0], zero, 0.0, zero, zero, False, False, control, skins)
    for k in range(t.size - 1):
        m = substeps[k]
        X[k + 1] = X[k]
        z = X[k + 1]
        at = next_interval(at)
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
            if at.step < m:
                if not at.far >= 0.0:
                    X[k + 1 :] = np.nan
                    R[k + 1 :] = np.nan
                    return loop_result(X, R, records, StepCode.NAN, at, counts)
                lists, counts, at = reselect(scene, state, lists, counts, at)
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
