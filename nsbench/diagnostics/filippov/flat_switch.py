"""Checks: layers |c| < w that are much wider than w in the state, where grad c is small.

In a layer |c| < w the state is within w / |grad c| of the surface as long as the gradient does not
change within that length. Where it vanishes (c = x^3) the layer is w^(1/3) wide, and where a switch
changes by less than w in all, the layer is never left.
"""

from __future__ import annotations

import numpy as np

from nsbench.case.scale import time_text
from nsbench.diagnostics.base import Finding
from nsbench.diagnostics.run_view import RunView, polygon, zero_between
from nsbench.dynamics.filippov.modes import sign_patterns
from nsbench.dynamics.filippov.switch_rates import evaluate_or_nan, switch_range
from nsbench.dynamics.filippov.vector_field import FilippovVectorField

# relative change of a slope within the layer width that follows from it: then the width is another
SLOPE_CHANGE = 0.5
MIN_POINTS = 100  # of a run that are examined, at least its known states
MAX_UNKNOWN_SIGNS = 4  # other switches in their layers of which both signs are tried


def check_flat_switch(run: RunView) -> Finding | None:
    """Find a state in a regularisation layer where its switch is flat.

    There the gradient of the switch changes by half within the width of the layer, which is then
    not width / slope, whichever way it is crossed. Examined on the polygon of the known states, and
    where it passes a surface; the layer is that of `penalty`, 1 / k.
    """
    width = run.resolution.layer
    where = find_flat_switch(run.vector_field, width, run.t, run.x) if width else ""
    return (
        Finding(
            "unverified",
            f"{where}: no error of size 1 / k is claimed there; write the switch so that its "
            "gradient does not vanish on the surface.",
        )
        if where
        else None
    )


def find_flat_switch(
    motion: FilippovVectorField, width: float, t: np.ndarray, X: np.ndarray
) -> str:
    """Return a clause that says where a run is in a layer, or crosses it, where its switch is flat.

    width: half-width of the layer in values of the switch. t (K,), X (K, n): known states, joined
    by a polygon. Returns "" if the switch is flat nowhere. Surfaces that depend on the time more
    than on the state are left out: they do not wait for the state.
    """
    times = _examined_times(t)
    state = polygon(t, X)
    with np.errstate(all="ignore"):
        c = np.array(
            [motion.switch(float(at), x) for at, x in zip(times, state(times).T, strict=True)]
        )
        met = [
            (zero_between(lambda t, i=i: motion.switch(t, state(t))[i], times[k], times[k + 1]), i)
            for k, i in np.argwhere(c[1:] * c[:-1] < 0.0)
        ]
        met += [(times[k], i) for k, i in np.argwhere(np.abs(c) < width)]
        for at, row in sorted(met):
            x = state(at)
            gradient = motion.gradients(float(at), x, np.arange(motion.d))[row]
            in_time = np.abs(motion.along(float(at), x, 1.0, 0.0 * x))[row] * (t[-1] - t[0])
            if in_time > np.abs(gradient) @ np.abs(X).max(axis=0):
                continue
            slope = float(np.linalg.norm(gradient))
            if _is_flat(motion, width, float(at), x, row, gradient):
                return (
                    f"At t = {time_text(at, 6)} the state is in the layer of surface {row} where "
                    "its switch "
                    f"is flat (a slope of {slope:.2g})"
                )
    return ""


def _is_flat(motion, width, t, x, row, gradient) -> bool:
    """Does the slope of a switch change within its layer, whichever way the layer is crossed?

    The ways are that of the gradient, which depends on the units of the coordinates, and the
    coordinate axes, which do not: where one of them crosses the layer at a steady slope, the layer
    is thin.
    """
    ways = (gradient, *np.eye(len(x)))
    return all(_changes_along(motion, width, t, x, row, way, gradient @ way) for way in ways)


def _changes_along(motion, width, t, x, row, way, slope) -> bool:
    """Does d c / d way change by SLOPE_CHANGE within width / slope of x, or vanish?"""
    if slope == 0.0:
        return True
    rows = np.arange(motion.d)
    nearby = [
        motion.gradients(t, x + side * width / slope * way, rows)[row] @ way for side in (1.0, -1.0)
    ]
    return bool(max(abs(s - slope) for s in nearby) > SLOPE_CHANGE * abs(slope))


def _examined_times(t: np.ndarray) -> np.ndarray:
    """At least MIN_POINTS times, all of t among them."""
    parts = -(-MIN_POINTS // (len(t) - 1))
    return np.append((t[:-1, None] + np.diff(t)[:, None] * np.arange(parts) / parts).ravel(), t[-1])


def check_never_leaves_layer(run: RunView) -> Finding | None:
    """Find a switch that stays in its layer, though the field depends on its sign.

    It is in the layer at all times that are examined, and would be wherever a displacement by the
    size of the state could take it: its sign is nowhere resolved.
    """
    width = run.resolution.layer
    if not width:
        return None
    times = _examined_times(run.t)
    states = run.state(times).T
    c = np.array([run.switch(float(at), x.copy()) for at, x in zip(times, states, strict=True)])
    change = np.fmax(switch_range(run.switch, float(run.t[-1]), run.x), np.ptp(c, axis=0))
    inside = (np.abs(c).max(axis=0) < width) & (0.0 < change) & (change < width)
    for i in np.flatnonzero(inside):
        for at, x, row in zip(times, states, c, strict=True):
            if _depends_on_sign(run.field, at, x, row, i, width):
                return Finding(
                    "unverified",
                    f"Switch {i} does not leave its layer: it changes by no more than "
                    f"{change[i]:.2g}: no error of size 1 / k is claimed there; take a larger k.",
                )
    return None


def _depends_on_sign(field, t, x, c, i, width) -> bool:
    """Does the field at (t, x) depend on sign i, for some signs of the switches in their layers?"""
    one = np.arange(len(c)) == i
    return any(
        not np.array_equal(
            evaluate_or_nan(field, t, x, np.where(one, 1.0, s)),
            evaluate_or_nan(field, t, x, np.where(one, -1.0, s)),
            equal_nan=True,
        )
        for s in _possible_signs(c, (np.abs(c) < width) & ~one)
    )


def _possible_signs(c: np.ndarray, unknown: np.ndarray) -> list:
    """The signs of the switches c (d,), with all patterns of the first few unknown ones."""
    signs = np.where(c >= 0.0, 1.0, -1.0)
    some = np.flatnonzero(unknown)[:MAX_UNKNOWN_SIGNS]
    out = []
    for pattern in sign_patterns(some.size):
        out.append(signs.copy())
        out[-1][some] = pattern
    return out
