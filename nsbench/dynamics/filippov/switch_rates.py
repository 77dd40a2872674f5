"""Rates of the switch functions of a Filippov system in the fields of their two sides.

The rate of switch c_i in the field F of a side is the derivative dc_i/dt along F, taken from a
central difference of c over +- dt: it needs values of the switch alone, and no derivatives of user
functions. A side leads inward (to the surface) or outward by the sign of its rate. Values where a
user's function raises are NaN, and no comparison with NaN is true.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

STEP = 1e-6  # of the time of a run: the time differences from which rates of switches are taken
ROUNDED = 16 * 2.0**-52  # relative rounding of a coordinate, with some room for a few operations
SIDE = 1e-3  # mean weight of a side from which a run slides rather than touches


def evaluate_or_nan(f: Callable, t: float, x: np.ndarray, *signs: np.ndarray) -> np.ndarray:
    """Evaluate a switch or field at x (n,), where the run need not have been.

    A scalar NaN where it raises.
    """
    try:
        return np.asarray(f(t, x.copy(), *signs), float)
    except Exception:
        return np.array(np.nan)


def rounding_of_switches(
    switch: Callable, t: float, x: np.ndarray, sizes: np.ndarray
) -> np.ndarray:
    """Return (d,) the changes of the switches by rounding of the time and of coordinates.

    sizes (n,): magnitudes of the coordinates whose relative rounding is meant.
    """
    here = evaluate_or_nan(switch, t, x)
    moved = [
        evaluate_or_nan(switch, t + ROUNDED * abs(t), x),
        *(evaluate_or_nan(switch, t, x + e) for e in np.diag(ROUNDED * sizes) if e.any()),
    ]
    return np.fmax.reduce([np.abs(c - here) for c in moved])


def switch_range(switch: Callable, t: float, X: np.ndarray, least: float = 0.0) -> np.ndarray:
    """Return (d,) the largest change of each switch at the end (t, X[-1]) of a run X (K, n).

    One coordinate at a time is displaced by the largest displacement or coordinate of the run, or
    by `least` if that is more.
    """
    x = X[-1]
    displacements = max(float(np.abs(X - X[0]).max()), float(np.abs(X).max()), least) * np.eye(
        x.size
    )
    here = evaluate_or_nan(switch, t, x)
    largest = np.zeros_like(here)
    for e in displacements:
        for s in (1.0, -1.0):
            largest = np.fmax(largest, np.abs(evaluate_or_nan(switch, t, x + s * e) - here))
    return largest


def one_sided_rates(
    switch: Callable, field: Callable, t: float, x: np.ndarray, i: int, dt: float
) -> tuple[float, float]:
    """Return the rates dc_i/dt in the fields of the positive and the negative side of surface i.

    The signs of all other surfaces are those at (t, x).
    """
    plus, minus = (rates_in_sector(switch, field, t, x, [i], [side], dt)[0] for side in (1.0, -1.0))
    return plus, minus


def rates_in_sector(
    switch: Callable, field: Callable, t: float, x: np.ndarray, rows, sides, dt: float
) -> np.ndarray:
    """Return (len(rows),) rates of the switches `rows` in the field with the signs `sides` there.

    The signs of all other surfaces are those at (t, x). NaN where the switch raises.
    """
    signs = np.where(evaluate_or_nan(switch, t, x) >= 0.0, 1.0, -1.0)
    signs[rows] = sides
    f = evaluate_or_nan(field, t, x, signs)
    change = evaluate_or_nan(switch, t + dt, x + dt * f) - evaluate_or_nan(
        switch, t - dt, x - dt * f
    )
    return change.ravel()[rows] / (2.0 * dt) if change.ndim else np.full(len(rows), np.nan)


def sliding_intervals(
    t: np.ndarray, contacts: tuple, impulse: np.ndarray, d: int
) -> tuple[np.ndarray, np.ndarray]:
    """Find the intervals in which a run slides on each of d surfaces, by the weights of the sides.

    t (K,), contacts: ids (0, i) of the columns of impulse (K, m), the integral of the weight of the
    positive side. Returns (K - 1, d) bool: the fields of both sides made the motion of the
    interval; and (K - 1, d) bool: they did so in a neighbouring interval too, so that the surface
    was not merely crossed.
    """
    mixed = np.zeros((len(t) + 1, d), bool)
    for column, ident in enumerate(contacts):
        weight = np.diff(impulse[:, column]) / np.diff(t)
        mixed[1:-1, ident[1]] = (weight > SIDE) & (weight < 1.0 - SIDE)
    return mixed[1:-1], mixed[1:-1] & (mixed[2:] | mixed[:-2])
