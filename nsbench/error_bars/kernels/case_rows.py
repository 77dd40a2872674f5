"""Drift and contacts of a case at one state, and the velocity that they leave it.

The functions of the case (drift, walls, ends, smooth) are called here. Where numba cannot compile
one, this file and those of the kernels that use it (local_piece, error_flow) run in Python; what
they call besides stays compiled.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from nsbench.compilation.decorators import inner_kernel
from nsbench.error_bars.kernels.cone_projection import constrained_velocity
from nsbench.error_bars.kernels.cubic import fill_moved, fill_scaled
from nsbench.error_bars.kernels.gram import shortest
from nsbench.error_bars.kernels.unit_gradients import (
    UNPLANNED,
    Constraints,
    Rows,
    chosen,
    every_row,
    fill_gaps,
)
from nsbench.linalg.max_norm import largest

CLOSED = 1e-12  # of own length: a gap that is zero up to rounding
REPAIRS = 20  # of a start at which contacts are closed up to CLOSED alone
TIME_STEP = 2.0**-20  # of own time, for the rate at which a moving constraint moves


class Calls(NamedTuple):
    """Functions of the case: drift (t, x, out), in the user's units, x = length y at the time
    origin + time t; walls (t, levels) and ends (t, anchors), which leave what does not move."""

    drift: Callable
    walls: Callable
    ends: Callable
    origin: float
    time: float
    length: float


class Listed(NamedTuple):
    """Contacts that are looked at, and what is evaluated for them.

    scene: the contacts and the affine rows. columns (m, w), count (m,): of the entries of their
    gradients. anchors (a,), levels (rows,): at the time last asked for; they are overwritten where
    constraints move. centre (n,), reach: all pairs are listed whose gap at the centre is at most
    the reach. is_flat: are all constraints listed, and all flat?
    """

    scene: Constraints
    columns: np.ndarray
    count: np.ndarray
    anchors: np.ndarray
    levels: np.ndarray
    centre: np.ndarray
    reach: float
    is_flat: bool
    is_moving: bool


@inner_kernel
def drift_at(calls: Calls, t: float, x: np.ndarray, f: np.ndarray) -> None:
    """Fill f (n,) with (T / L) drift(t0 + T t, L x)."""
    own = np.empty(len(x))
    fill_scaled(x, calls.length, own)
    calls.drift(calls.origin + calls.time * t, own, f)
    fill_scaled(f, calls.time / calls.length, f)


@inner_kernel
def rows_at(
    calls: Calls,
    smooth: Callable | None,
    listed: Listed,
    rows: Rows,
    t: float,
    x: np.ndarray,
    g: np.ndarray,
    V: np.ndarray,
) -> None:
    """Fill g (m,) with the gaps of the rows, and V (m, w) with their unit gradients, or V (0, 0)
    with none. smooth (t, x, at, g, V): fills those of Smooth constraints, None without them."""
    if listed.is_moving:
        calls.walls(t, listed.levels)
        calls.ends(t, listed.anchors)
    fill_gaps(listed.scene, rows.at, listed.anchors, listed.levels, x, g, V)
    if smooth is not None:
        smooth(t, x, rows.at, g, V)


@inner_kernel
def gaps_at(
    calls: Calls,
    smooth: Callable | None,
    listed: Listed,
    rows: Rows,
    t: float,
    x: np.ndarray,
    g: np.ndarray,
) -> None:
    """Fill g (m,) with the gaps of the rows at the time t and the state x (n,)."""
    rows_at(calls, smooth, listed, rows, t, x, g, np.empty((0, 0)))


@inner_kernel
def rates_at(
    calls: Calls,
    smooth: Callable | None,
    listed: Listed,
    rows: Rows,
    t: float,
    x: np.ndarray,
    out: np.ndarray,
) -> None:
    """Fill out (m,) with the partial derivatives of the gaps in time, by central differences."""
    before = np.zeros(len(out))
    out[:] = 0.0
    if listed.is_moving:
        gaps_at(calls, smooth, listed, rows, t - TIME_STEP, x, before)
        gaps_at(calls, smooth, listed, rows, t + TIME_STEP, x, out)
        fill_moved(out, -1.0, before, out)
        fill_scaled(out, 0.5 / TIME_STEP, out)


@inner_kernel
def projected_at(
    calls: Calls,
    smooth: Callable | None,
    listed: Listed,
    closed: Rows,
    pushes: np.ndarray,
    t: float,
    x: np.ndarray,
    f: np.ndarray,
    v: np.ndarray,
    q: np.ndarray,
) -> None:
    """Fill v (n,) with the projection of the drift f (n,) on the velocities that violate none of
    the closed contacts, and q (m,) with their multipliers. pushes (m,): those that pushed last,
    tried first; overwritten."""
    m = len(closed.at)
    if m == 0:
        fill_scaled(f, 1.0, v)
        return
    rates = np.empty(m)
    V = np.empty(closed.C.shape)
    rows_at(calls, smooth, listed, closed, t, x, rates, V)
    rates_at(calls, smooth, listed, closed, t, x, rates)
    constrained_velocity(closed.plan, closed.C, V, closed.count, rates, f, pushes, v, q)


@inner_kernel
def velocity_at(
    calls: Calls,
    smooth: Callable | None,
    listed: Listed,
    closed: Rows,
    pushes: np.ndarray,
    t: float,
    x: np.ndarray,
    v: np.ndarray,
    q: np.ndarray,
) -> None:
    """Do the same for the drift at the time t and the state x (n,)."""
    f = np.empty(len(x))
    drift_at(calls, t, x, f)
    projected_at(calls, smooth, listed, closed, pushes, t, x, f, v, q)


@inner_kernel
def step_onto_face(
    calls: Calls,
    smooth: Callable | None,
    listed: Listed,
    rows: Rows,
    t: float,
    x: np.ndarray,
    is_refined: bool,
) -> float:
    """Take one Gauss-Newton step of x (n,) to where all rows are closed; return its largest
    entry."""
    g = np.empty(len(rows.at))
    V = np.empty(rows.C.shape)
    step = np.empty(len(x))
    rows_at(calls, smooth, listed, rows, t, x, g, V)
    shortest(rows.plan, rows.C, V, rows.count, g, is_refined, step)
    fill_moved(x, -1.0, step, x)
    return largest(step)


@inner_kernel
def closed_at_start(
    calls: Calls,
    smooth: Callable | None,
    listed: Listed,
    t: float,
    y: np.ndarray,
    gaps: np.ndarray,
) -> Rows:
    """Return the contacts that are closed at y (n,), and fill gaps (m,) with those of all.

    What is closed up to CLOSED on flat faces is closed up to rounding: y moves there.
    """
    every = every_row(listed.scene, listed.columns, listed.count, UNPLANNED)
    closed = every
    for _ in range(REPAIRS):
        gaps_at(calls, smooth, listed, every, t, y, gaps)
        closed = chosen(listed.scene, every, gaps <= CLOSED, len(y))
        if len(closed.at) == 0 or not closed.is_straight:
            break
        is_straight = closed.is_straight  # no literal
        if step_onto_face(calls, smooth, listed, closed, t, y, is_straight) <= CLOSED / 8.0:
            break
    return closed
