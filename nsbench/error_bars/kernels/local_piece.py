"""One smooth piece of a local solution: a step of the constrained motion, cut at its next event.

From a feasible state the motion goes on with the velocity that is the drift's projection on the
cone of velocities which violate nothing (Moreau): one step of the classical Runge-Kutta method,
which a cubic Hermite polynomial joins. The piece ends where the first open gap closes on it, or the
first multiplier vanishes; both times are found by bisection.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from nsbench.compilation.borrowed_arrays import borrowed
from nsbench.compilation.decorators import inner_kernel, njit
from nsbench.dynamics.contacts.kernels.contact_arrays import ANCHOR, PAIR
from nsbench.error_bars.kernels.case_rows import (
    CLOSED,
    Calls,
    Listed,
    closed_at_start,
    drift_at,
    gaps_at,
    projected_at,
    rates_at,
    rows_at,
    step_onto_face,
    velocity_at,
)
from nsbench.error_bars.kernels.cone_projection import least_multiplier, tangential_rest
from nsbench.error_bars.kernels.cubic import (
    BEYOND_SIMPSON,
    BOOLE,
    HIDDEN,
    HIDDEN_WEIGHTS,
    QUARTERS,
    distance,
    fill_controls,
    fill_moved,
    fill_powers,
    fill_runge_kutta,
    fill_scaled,
    fill_slope,
    fill_state,
    fill_weighted,
    norm,
    turned,
    upper_mean,
)
from nsbench.error_bars.kernels.unit_gradients import UNPLANNED, chosen, every_row
from nsbench.linalg.max_norm import largest

OUTSIDE = 1e3 * CLOSED  # a state that violates no constraint by more counts as one of S
ROUNDING = 1e-16  # of the state
NEWTON = 6  # Gauss-Newton steps onto a curved face
LONG = 8.0  # times the reach: a list that holds far more than what is asked for is made anew
STIFF = 1.0  # rate of the drift times the length of a piece that is resolved
STIFFEST = 50.0  # and of one that is not divided for it
CLOSING = 45  # bits of a piece to which the time is known at which a gap closes
RELEASE = 20  # and at which a multiplier vanishes, which needs less: the motion has no kink there
MIDDLE = 2  # of QUARTERS
LAST = 4
SECOND = 2  # of the slopes of a step: at its second stage
END = 4  # and at its end
LOOKS = 16  # places of a piece where a gap may be found closed


class Piece(NamedTuple):
    """A piece over a length; asked: the reach of the list that is needed, if it is not the given
    one, else 0.

    is_cut: does it end before the length that was asked for? states (4, n): Bezier control points;
    end (n,): its last state. acting (m,), closed: places in the list of contacts that push, and of
    all that are closed; loads (5, m): multipliers of the former at the quarters. slack: bound of
    the integral of its residual. along (n,): integral of the drift, doubt: of that.
    """

    asked: float
    length: float
    is_cut: bool
    states: np.ndarray
    end: np.ndarray
    acting: np.ndarray
    closed: np.ndarray
    loads: np.ndarray
    slack: float
    along: np.ndarray
    doubt: float


@inner_kernel
def _take_step(calls, smooth, listed, closed, pushes, t, h, y, v, powers):
    """Take a step h of the classical Runge-Kutta method from y (n,) with the velocity v (n,).

    Fills powers (4, n) with the coefficients of a cubic Hermite polynomial through it. Returns how
    fast the drift draws neighbouring states together, as two stages of the step show it (Hairer &
    Wanner, Solving ODEs II, 1996, IV.2).
    """
    x = np.empty(len(y))
    q = np.empty(len(closed.at))
    slopes = np.empty((5, len(y)))
    fill_scaled(v, 1.0, slopes[0])
    for k in range(1, 5):
        if k < 4:
            share = 0.5 if k < 3 else 1.0
            fill_moved(y, share * h, slopes[k - 1], x)
        else:
            share = 1.0
            fill_runge_kutta(y, h, slopes, x)
        velocity_at(calls, smooth, listed, closed, pushes, t + share * h, x, slopes[k], q)
    fill_powers(y, h, v, x, slopes[END], powers)
    apart = 0.5 * h * distance(slopes[1], v)
    return distance(slopes[SECOND], slopes[1]) / apart if apart > 0.0 else 0.0


@inner_kernel
def _least_load(calls, smooth, listed, acting, powers, w, t):
    """Return the least multiplier of the acting contacts at the part w of the step, the time t."""
    x = np.empty(powers.shape[1])
    f = np.empty(len(x))
    V = np.empty(acting.C.shape)
    rates = np.empty(len(acting.at))
    fill_state(powers, w, x)
    drift_at(calls, t, x, f)
    rows_at(calls, smooth, listed, acting, t, x, rates, V)
    rates_at(calls, smooth, listed, acting, t, x, rates)
    return least_multiplier(acting.plan, acting.C, V, acting.count, rates, f)


@inner_kernel
def _release(calls, smooth, listed, acting, powers, t, h):
    """Return the part of the step at which the first acting multiplier vanishes, 1 if none does, by
    bisection."""
    if len(acting.at) == 0:
        return 1.0
    low = -1.0
    high = 0.0
    w = 0.0
    # both ends first: all push at the start, and not all at the end
    for k in range(RELEASE + 2):
        is_negative = _least_load(calls, smooth, listed, acting, powers, w, t + w * h) < 0.0
        if k < 2 and is_negative != (k == 1):
            return 1.0
        if is_negative:
            high = w
        else:
            low = w
        w = 1.0 if k == 0 else 0.5 * (low + high)
    return high


@inner_kernel
def _open_contacts(listed, gaps, powers):
    """Return the open contacts that may close along the cubic powers (4, n).

    A distance changes by at most twice the way of a particle: in a large scene that is far less
    than the way of the whole state, by which candidates were listed.
    """
    contacts = listed.scene.contacts
    is_open = gaps > CLOSED
    if not (listed.is_flat or listed.is_moving):
        way = np.zeros(powers.shape[1])
        x = np.empty(len(way))
        for look in range(1, LOOKS + 1):
            fill_state(powers, look / LOOKS, x)
            for c in range(len(x)):
                way[c] = max(way[c], abs(x[c] - powers[0, c]))
        # more than that: between the places that were looked at the curve may go further
        far = 4.0 * norm(way) + CLOSED
        near = 4.0 * np.sqrt(3.0) * largest(way) + CLOSED
        for k in range(len(gaps)):
            is_distance = contacts.kind[k] == PAIR or contacts.kind[k] == ANCHOR
            is_open[k] &= gaps[k] <= (near if is_distance else far)
    every = every_row(listed.scene, listed.columns, listed.count, UNPLANNED)
    return chosen(listed.scene, every, is_open, UNPLANNED)


@inner_kernel
def _closing(calls, smooth, listed, rows, powers, t, h):
    """Return the part of the step at which the first of the open rows closes, by bisection;
    infinity where none is negative at the LOOKS."""
    x = np.empty(powers.shape[1])
    g = np.empty(len(rows.at))
    for look in range(1, LOOKS + 1 if len(g) > 0 else 0):
        high = look / LOOKS
        fill_state(powers, high, x)
        gaps_at(calls, smooth, listed, rows, t + high * h, x, g)
        # a gap that is not a number closes at once
        late = chosen(listed.scene, rows, ~(g >= 0.0), UNPLANNED)
        if len(late.at) == 0:
            continue
        g = np.empty(len(late.at))
        low = 0.0
        for _ in range(CLOSING):
            w = 0.5 * (low + high)
            fill_state(powers, w, x)
            gaps_at(calls, smooth, listed, late, t + w * h, x, g)
            if np.all(g >= 0.5 * CLOSED):
                low = w
            else:
                high = w
        return high
    return np.inf


@inner_kernel
def _violation(calls, smooth, listed, resting, powers, share, t, h):
    """Return the part of the step, at most `share`, up to which no resting row is violated."""
    x = np.empty(powers.shape[1])
    g = np.empty(len(resting.at))
    for look in range(1, LOOKS + 1 if len(g) > 0 else 0):
        w = share * look / LOOKS
        fill_state(powers, w, x)
        gaps_at(calls, smooth, listed, resting, t + w * h, x, g)
        if g.min() < -OUTSIDE:
            return share * (look - 1.0 if look > 1 else 0.5) / LOOKS
    return share


@inner_kernel
def _move_onto_faces(calls, smooth, listed, acting, t, H, X):
    """Move the states X (5, n) at the quarters to where the acting contacts are closed.

    Returns by how much the curve is longer for it where no part of the residual knows of it: on
    flat faces.
    """
    before = X.copy()
    for e in range(len(X)):
        at = t + QUARTERS[e] * H
        for _ in range(1 if acting.is_straight else NEWTON):
            step = step_onto_face(calls, smooth, listed, acting, at, X[e], acting.is_straight)
            if step * step <= ROUNDING * largest(X[e]):
                break  # they converge quadratically: the next step is one of rounding
    return turned(X - before) if acting.is_straight else 0.0


@inner_kernel
def _hidden_size(calls, t, H, powers, share, F):
    """Return the largest |f - p| at HIDDEN places, for the drift f and the polynomial p through its
    values F (5, n) at the quarters of the piece."""
    x = np.empty(powers.shape[1])
    f = np.empty(len(x))
    expected = np.empty(len(x))
    most = 0.0
    for a in range(len(HIDDEN)):
        fill_state(powers, share * HIDDEN[a], x)
        drift_at(calls, t + H * HIDDEN[a], x, f)
        fill_weighted(HIDDEN_WEIGHTS[a], F, expected)
        most = max(most, distance(f, expected))
    return most


@inner_kernel
def _residual_sizes(calls, smooth, listed, acting, t, H, X, dX, F, loads):
    """Fill F (5, n) with the drift at the quarters, loads (5, m) with the multipliers of the acting
    contacts, and return (5,) the sizes of what dX - F lacks beside these."""
    rest = np.empty(X.shape[1])
    V = np.empty(acting.C.shape)
    rates = np.empty(len(acting.at))
    sizes = np.empty(len(X))
    for e in range(len(X)):
        at = t + QUARTERS[e] * H
        drift_at(calls, at, X[e], F[e])
        fill_moved(dX[e], -1.0, F[e], rest)
        if len(acting.at) > 0:
            rows_at(calls, smooth, listed, acting, at, X[e], rates, V)
            rates_at(calls, smooth, listed, acting, at, X[e], rates)
            tangential_rest(
                acting.plan, acting.C, V, acting.count, rates, dX[e], rest, loads[e]
            )
        sizes[e] = norm(rest)
    return sizes


@inner_kernel
def _measured(calls, smooth, listed, closed, pushes, t, h, share, powers, jump, is_cut):
    """Return the piece over the part `share` of the step h, whose start was moved by `jump`."""
    n = powers.shape[1]
    H = share * h
    X = np.empty((len(QUARTERS), n))
    dX = np.empty(X.shape)
    F = np.empty(X.shape)
    for e in range(len(X)):
        fill_state(powers, share * QUARTERS[e], X[e])
        fill_slope(powers, share * QUARTERS[e], h, dX[e])
    q = np.zeros(len(closed.at))
    rise = np.empty(n)
    fall = np.empty(n)
    along = np.empty(n)
    velocity_at(calls, smooth, listed, closed, pushes, t + 0.5 * H, X[MIDDLE], along, q)
    acting = chosen(listed.scene, closed, q > 0.0, n)
    fill_scaled(dX[0], H, rise)
    fill_scaled(dX[LAST], H, fall)
    first = X[0].copy()
    last = X[LAST].copy()
    if len(acting.at) > 0:
        jump += _move_onto_faces(calls, smooth, listed, acting, t, H, X)
    states = np.empty((4, n))
    fill_controls(first, last, rise, fall, X[MIDDLE], states)
    loads = np.empty((len(X), len(acting.at)))
    sizes = _residual_sizes(calls, smooth, listed, acting, t, H, X, dX, F, loads)
    unseen = H * _hidden_size(calls, t, H, powers, share, F)
    slack = jump + unseen + H * upper_mean(sizes)
    fill_weighted(BEYOND_SIMPSON, F, along)
    doubt = H * norm(along) + unseen
    fill_weighted(BOOLE, F, along)
    fill_scaled(along, H, along)
    return Piece(
        0.0, H, is_cut, states, X[LAST].copy(), acting.at, closed.at, loads, slack, along, doubt
    )


@inner_kernel
def _not_listed(reach, n):
    """Return that a list of this reach is needed."""
    states = np.empty((4, n))
    none = np.empty(0, np.int64)
    return Piece(
        reach, 0.0, False, states, states[0], none, none, np.empty((5, 0)), 0.0, states[1], 0.0
    )


@njit(cache=True, error_model="numpy")
def follow_piece(
    drift: Callable,
    walls: Callable,
    ends: Callable,
    smooth: Callable | None,
    units: tuple[float, float, float],
    listed: Listed,
    t: float,
    dt: float,
    start: np.ndarray,
) -> Piece:
    """Follow the constrained motion from the state start (n,) at the time t, over at most dt.

    units: origin, time and length, of Calls; the others as there and in rows_at.
    """
    listed = borrowed(listed)
    origin, time, length = units
    calls = Calls(drift, walls, ends, origin, time, length)
    y = start.copy()
    v = np.empty(len(y))
    f = np.empty(len(y))
    drift_at(calls, t, y, f)
    reach = 4.0 * dt * norm(f) + CLOSED
    # the gap of a pair changes by at most sqrt(2) times what the state moves
    if not listed.is_flat:
        needed = reach + 2.0 * distance(y, listed.centre)
        if not needed <= listed.reach <= LONG * reach:
            return _not_listed(reach, len(y))
    gaps = np.empty(len(listed.count))
    closed = closed_at_start(calls, smooth, listed, t, y, gaps)
    q = np.zeros(len(closed.at))
    pushes = np.zeros(len(q), np.bool_)
    projected_at(calls, smooth, listed, closed, pushes, t, y, f, v, q)
    acting = chosen(listed.scene, closed, q > 0.0, len(y))
    powers = np.empty((4, len(y)))
    h = dt
    is_stable = False
    is_released = False
    while True:
        rate = _take_step(calls, smooth, listed, closed, pushes, t, h, y, v, powers)
        if not is_stable and STIFF < h * rate <= STIFFEST:
            h = STIFF / rate  # a stable step, unless that would take too many
            is_stable = True
            continue
        share = 1.0 if is_released else _release(calls, smooth, listed, acting, powers, t, h)
        if not share < 1.0:
            break
        h *= share
        is_stable = True
        is_released = True
    is_open = _open_contacts(listed, gaps, powers)
    share = min(1.0, _closing(calls, smooth, listed, is_open, powers, t, h))
    if listed.is_flat:
        # a contact that is closed at the start and does not act opens, and may close again
        resting = chosen(listed.scene, closed, ~(q > 0.0), UNPLANNED)
        share = _violation(calls, smooth, listed, resting, powers, share, t, h)
    jump = distance(y, start)
    is_cut = share * h < dt
    return _measured(calls, smooth, listed, closed, pushes, t, h, share, powers, jump, is_cut)
