"""PBD with accumulated multipliers and warm starts: a variant of the study, no method of its own.

A step from x, with impulses c_k of the last one (contacts k with gaps g_k >= 0):

    x <- x + h f + sum_k c_k grad g_k(x + h f)                       start
    c_k <- max(0, c_k - g_k(x) / |grad g_k|^2),  x <- x + (change of c_k) grad g_k(x)    sweeps

Impulses accumulate over the sweeps of a step, so that a start that is too large is taken back;
a contact keeps its c_k while it is positive. This is projected Gauss-Seidel on the problem of
catching-up, linearised where each contact is met. A fixed point has g_k = 0 at every loaded
contact, where that of one sweep from zero keeps overlaps of the order of h.
Sources: E. Catto, Iterative dynamics with temporal coherence, Game Developers Conference (2005),
for accumulated and kept impulses; M. Macklin, M. Mueller, N. Chentanez, XPBD, Motion in Games
(2016), for multipliers that accumulate over the sweeps of a step of PBD (from zero there).
"""

from __future__ import annotations


import numpy as np

from nsbench.case import Case
from nsbench.problem import Smooth
from nsbench.solvers import get, solve
from nsbench.solvers.base import grid
from nsbench.trajectory import Trajectory

WARM = "warm "  # before the spec of a PBD: its sweeps, order and seed, with warm starts


def run_variant(case: Case, method: str, h: float) -> Trajectory:
    """Run a method with the step h, or PBD with warm starts where WARM stands before its spec."""
    if method.startswith(WARM):
        return accumulate(case, method.removeprefix(WARM), h)
    accuracy = get(method).accuracy
    return solve(case, method, **{accuracy: h})


def accumulate(
    case: Case, method: str, h: float, is_kept: bool = True, is_taken_back: bool = True
) -> Trajectory:
    """Run PBD with accumulated multipliers on a case; method: the spec of a PBD.

    is_kept: the multipliers of a step start the next one, else zero. is_taken_back: sums of
    corrections are clamped at zero, else single corrections, as in PBD; without both the run is
    that of PBD. All pairs of particles are candidates. Raises ValueError for Smooth constraints.
    """
    from nsbench.compilation.case_functions import (
        bind_loop,
        compile_functions,
        curve_function,
        drift_function,
        loop_in_python,
    )
    from nsbench.dynamics.contacts.constraint_set import ConstraintSet
    from nsbench.dynamics.contacts.kernels.contact_arrays import AffineRows
    from nsbench.solvers.common.initial_state import initial_state
    from nsbench.solvers.pbd.method import build_trajectory
    from nsbench.solvers.pbd.sweep_order import constraint_keys
    from nsbench.studies.multipliers.kernels.accumulated_loop import march

    if any(isinstance(c, Smooth) for c in case.problem.constraints):
        raise ValueError(f"{case.key}: accumulated multipliers are not written for Smooth")
    pbd = get(method)
    g = grid(case.t, h)
    scene = ConstraintSet(case.problem, case.n)
    x0 = initial_state(case, scene)
    t0 = float(case.t[0])
    near = scene.near(x0, np.inf, t0)
    keys = constraint_keys(scene, near, pbd.order, pbd.seed, x0)
    lists = near.take(np.argsort(keys)).arrays()
    anchors = scene.anchors(t0)
    functions = compile_functions(
        drift_function(case.problem.drift, case.n),
        curve_function(scene.b_factory, scene.inv2.size, scene.b),
        curve_function(scene.anchor_factory, anchors.size, scene.anchors),
    )
    rows = AffineRows(scene.ptr, scene.cols, scene.vals, scene.inv2)
    options = (scene.moving, g.t, g.substeps, pbd.sweeps, is_kept, is_taken_back)
    args = (*functions.functions, *options, x0, lists, rows, scene.b(t0), anchors)
    loop = bind_loop(march, functions.loop, args, loop_in_python)
    return build_trajectory(case, g, functions.stats, loop(*args))
