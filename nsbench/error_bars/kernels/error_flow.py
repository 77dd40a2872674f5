"""Linearised flow of a small error of a motion over a time in which the same contacts act."""

from collections.abc import Callable

import numpy as np

from nsbench.compilation.decorators import inner_kernel, njit
from nsbench.error_bars.kernels.case_rows import Calls, Listed, drift_at, rows_at
from nsbench.error_bars.kernels.cubic import fill_moved, fill_scaled, norm
from nsbench.error_bars.kernels.gram import add_multiplied, shortest, times_row
from nsbench.error_bars.kernels.unit_gradients import UNPLANNED, every_row

NUDGE = 2.0**-20  # of own length, for differences of drifts and normals


@inner_kernel
def _drifted(calls, t, x, delta, rate):
    """Fill rate (n,) with J delta, at which the drift parts two motions that are delta apart."""
    length = norm(delta)
    near = np.empty(len(x))
    down = np.empty(len(x))
    fill_moved(x, NUDGE / length, delta, near)
    drift_at(calls, t, near, rate)
    fill_moved(x, -NUDGE / length, delta, near)
    drift_at(calls, t, near, down)
    fill_moved(rate, -1.0, down, rate)
    fill_scaled(rate, 0.5 * length / NUDGE, rate)


@inner_kernel
def _add_turning(calls, smooth, listed, rows, t, x, q, delta, rate):
    """Add (d/dx N^T q) delta to rate (n,), for the multipliers q (m,) of unit gradients: the
    curvature of contacts under load drives neighbouring motions apart."""
    length = norm(delta)
    near = np.empty(len(x))
    turned = np.zeros(len(x))
    g = np.empty(len(q))
    V = np.empty(rows.C.shape)
    load = np.empty(len(q))
    for sign in (1.0, -1.0):
        fill_moved(x, sign * NUDGE / length, delta, near)
        rows_at(calls, smooth, listed, rows, t, near, g, V)
        fill_scaled(q, sign * 0.5 * length / NUDGE, load)
        add_multiplied(rows.C, V, rows.count, len(q), load, turned)
    fill_moved(rate, 1.0, turned, rate)


@inner_kernel
def _make_tangential(calls, smooth, listed, t, x, delta):
    """Take from delta (n,) what opens or closes a contact of the list."""
    m = len(listed.count)
    if m == 0:
        return
    rows = every_row(listed.scene, listed.columns, listed.count, len(delta))
    g = np.empty(m)
    V = np.empty(rows.C.shape)
    normal = np.empty(len(delta))
    rows_at(calls, smooth, listed, rows, t, x, g, V)
    for k in range(m):
        g[k] = times_row(rows.C, V, rows.count, k, delta)
    shortest(rows.plan, rows.C, V, rows.count, g, True, normal)
    fill_moved(delta, -1.0, normal, delta)


@inner_kernel
def _grow(H, rate, delta, new):
    """Fill new (n,) with the error delta (n,) after a time H at this rate; where that would be too
    long a step for Euler's rule, by the exponential of the rate along delta."""
    length = norm(delta)
    if norm(rate) * H <= length:
        fill_moved(delta, H, rate, new)
        return
    along = 0.0
    for c in range(len(delta)):
        along += delta[c] * rate[c]
    fill_scaled(delta, np.exp(H * along / length**2), new)


@njit(cache=True, error_model="numpy")
def carry_error(
    drift: Callable,
    walls: Callable,
    ends: Callable,
    smooth: Callable | None,
    face_smooth: Callable | None,
    units: tuple[float, float, float],
    acting: Listed,
    face: Listed,
    t: float,
    H: float,
    states: np.ndarray,
    q: np.ndarray,
    delta: np.ndarray,
    new: np.ndarray,
    along: np.ndarray,
) -> None:
    """Fill new (n,) with the error delta (n,) after a time H > 0, and along (n,) with the integral
    of J delta over it.

    Its rate is J delta + (d/dx N^T q) delta on the contacts `acting` with multipliers q (m,), but
    for what contacts take off it along their normals: those of `face` at the end, which act before
    and behind it. states (2, n): of the motion in the middle and at the end. smooth, face_smooth:
    of the two lists, as in rows_at.
    """
    origin, time, length = units
    calls = Calls(drift, walls, ends, origin, time, length)
    n = len(delta)
    at = t + 0.5 * H
    rate = np.empty(n)
    _drifted(calls, at, states[0], delta, rate)
    rows = every_row(acting.scene, acting.columns, acting.count, UNPLANNED)
    if len(rows.at) > 0 and not rows.is_straight:
        _add_turning(calls, smooth, acting, rows, at, states[0], q, delta, rate)
    _grow(H, rate, delta, new)
    _make_tangential(calls, face_smooth, face, t + H, states[1], new)
    middle = np.empty(n)
    fill_moved(delta, 1.0, new, middle)
    fill_scaled(middle, 0.5, middle)
    along[:] = 0.0
    if norm(middle) > 0.0:
        _drifted(calls, at, states[0], middle, along)
        fill_scaled(along, H, along)
