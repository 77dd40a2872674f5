"""Runs that stay on a surface which both fields leave: they may leave it at any time, and no one
says which is meant."""

from __future__ import annotations

from itertools import product

import numpy as np

from nsbench.case import Case
from nsbench.compilation.factories import as_numpy
from nsbench.trajectory import Status, Trajectory

POINTS = 40  # of a run that are looked at, at least its samples
ON = 1e-9  # of the largest value of a switch: a state this near is on its surface
STEP = 1e-6  # of the run: the differences that rates of switches are taken from
ASIDE = 1e-9  # mean weight of a side below which a run was on the other alone
ROUNDED = (
    16 * 2.0**-52
)  # of each coordinate: and so near that nothing of a motion beside it is left
SIDE = 1e-3  # mean weight of a side from which a run slides rather than touches
REST = 1e-9  # of the largest rate: what differences leave of one that is zero
BOTH = "both fields leave: it may leave to either side"
RESTS = "one field leaves, while the other leaves it at rest there: it may leave"
MEET = 4  # surfaces through one point whose sectors are all looked at
CLEAR = 1e-4  # of the largest rate: below it, nothing is said of its sign


def check_repulsive_sliding(case: Case, traj: Trajectory) -> Status | None:
    """degenerate, if the state is on one surface at two samples in a row, and both fields lead away
    from it there or between, or one does and the other is at rest (Filippov 1988, section 10: the
    solution to the right is not unique); None for cases that say so of themselves.

    A run that was on one side alone meanwhile has not stayed, unless that side is at rest: it left
    and came back. A surface that it came to between two samples, and by mixed fields is on at the
    second, is looked at there.
    """
    if not case.unique or len(traj.t) < 2:
        return None
    switch = as_numpy(case.problem.switch)
    field = as_numpy(case.problem.field)
    c = np.array([switch(t, x.copy()) for t, x in zip(traj.t, traj.x, strict=True)])
    size = np.maximum(np.abs(c).max(axis=0), switch_range(switch, traj.t[-1], traj.x))
    side = _side(traj, c.shape[1])
    on = np.abs(c) <= ON * size
    # what fell there is left with a rounding of its fall, and stands; what decays never is
    exactly, fallen = (
        np.array(
            [
                np.abs(row) <= rounding(switch, t, x, np.fmax(np.abs(x), least))
                if near.any()
                else near
                for row, near, t, x in zip(c, on, traj.t, traj.x, strict=True)
            ]
        )
        for least in (0.0, np.abs(traj.x).max(axis=0))
    )
    stands = (exactly[1:] & exactly[:-1]) | (fallen[1:] & fallen[:-1] & (c[1:] == c[:-1]))
    stayed = np.where(side == 0.0, on[1:] & on[:-1], stands)
    came, (_, slid) = ~stayed & fallen[1:] & (side == 0.0), sliding_intervals(traj, c.shape[1])
    parts = -(-POINTS // (len(traj.t) - 1))
    last = np.arange(parts) == parts - 1
    for i in np.flatnonzero((stayed | came).any(axis=0)):
        others = np.delete(slid, i, axis=1).any(axis=1)  # in layers, not on surfaces
        spans = np.flatnonzero((stayed | came)[:, i] & (on[1:].sum(axis=1) == 1) & ~others)
        times = [
            [(1.0 - a) * traj.t[k] + a * traj.t[k + 1] for a in np.arange(1, parts + 1) / parts]
            for k in spans
        ]
        rates = np.array(
            [
                [
                    one_sided_rates(
                        switch, field, t, _at(traj, k, t), i, STEP * (traj.t[-1] - traj.t[0])
                    )
                    for t in row
                ]
                for k, row in zip(spans, times, strict=True)
            ]
        ).reshape(len(spans), parts, 2)
        rates[~(stayed[spans, i][:, None] | last)] = np.nan
        rates /= max(1e-300, float(np.fmax.reduce(np.abs(rates), axis=None, initial=0.0)))
        (plus, minus), alone = (rates[..., 0], rates[..., 1]), side[spans, i][:, None]
        for found, what in (
            ((alone == 0.0) & (plus > CLEAR) & (minus < -CLEAR), BOTH),
            ((alone > 0.0) & (minus < -CLEAR) & _rests(plus), RESTS),
            ((alone < 0.0) & (plus > CLEAR) & _rests(minus), RESTS),
        ):
            for row, part in np.argwhere(found)[:1]:
                return Status(
                    "degenerate",
                    f"At t = {times[row][part]:.6g} the state is on surface {i}, which {what} at "
                    f"any "
                    "time.",
                )
    return _left(traj, switch, field, stayed, stayed | came, on, parts)


def _left(traj, switch, field, stayed, held, on, parts) -> Status | None:
    """degenerate, if the state stays where surfaces meet, or are one, and the field of a sector
    leads into that sector."""
    for k in np.flatnonzero((held.sum(axis=1) > 1) & np.all(held == on[1:], axis=1)):
        rows = np.flatnonzero(held[k])
        sectors = (
            np.array(list(product((1.0, -1.0), repeat=rows.size))) if rows.size <= MEET else ()
        )
        times = [(1.0 - a) * traj.t[k] + a * traj.t[k + 1] for a in np.arange(1, parts + 1) / parts]
        dt = STEP * (traj.t[-1] - traj.t[0])
        rates = np.array(
            [
                [rates_in_sector(switch, field, t, _at(traj, k, t), rows, s, dt) for s in sectors]
                for t in times
            ]
        )
        rates = rates.reshape(parts, len(sectors), rows.size)
        rates[: 0 if stayed[k, rows].all() else -1] = np.nan
        rates /= np.fmax(np.fmax.reduce(np.abs(rates), axis=(0, 1), initial=0.0), 1e-300)
        for part, _ in np.argwhere(np.all(rates * sectors > CLEAR, axis=2))[:1]:
            return Status(
                "degenerate",
                f"At t = {times[part]:.6g} the state is on surfaces {', '.join(map(str, rows))}, "
                f"and the "
                "field of a side leads to that side: it may leave at any time.",
            )
    return None


def _at(traj, k: int, t: float) -> np.ndarray:
    """The state at t between the samples k and k + 1, on a straight line."""
    a = (t - traj.t[k]) / (traj.t[k + 1] - traj.t[k])
    return (1.0 - a) * traj.x[k] + a * traj.x[k + 1]


def rounding(switch, t, x, sizes) -> np.ndarray:
    """(d,) what rounding of coordinates of these sizes (n,), and of time, makes of the switches."""
    here = evaluate_or_nan(switch, t, x)
    moved = [
        evaluate_or_nan(switch, t + ROUNDED * abs(t), x),
        *(evaluate_or_nan(switch, t, x + e) for e in np.diag(ROUNDED * sizes) if e.any()),
    ]
    return np.fmax.reduce([np.abs(c - here) for c in moved])


def _rests(rate) -> np.ndarray:
    """(spans, 1) whether the rates (spans, parts) of a side vanish all the time between two
    samples."""
    return np.all(np.abs(rate) <= REST, axis=1, keepdims=True)


def _side(traj, d: int) -> np.ndarray:
    """(K - 1, d) 1 or -1 where that side of a surface alone made the motion between two samples,
    else (or not known) 0."""
    out = np.zeros((len(traj.t) - 1, d))
    for column, ident in enumerate(traj.contacts):
        weight = np.diff(traj.impulse[:, column]) / np.diff(traj.t)
        out[:, ident[1]] = np.where(weight < ASIDE, -1.0, np.where(weight > 1.0 - ASIDE, 1.0, 0.0))
    return out


def sliding_intervals(traj, d: int) -> tuple[np.ndarray, np.ndarray]:
    """(K - 1, d) whether the fields of both sides of a surface made the motion between two states;
    and whether they did so in the next interval or the last one too: then the surface was not
    crossed alone."""
    mixed = np.zeros((len(traj.t) + 1, d), bool)
    for column, ident in enumerate(traj.contacts):
        weight = np.diff(traj.impulse[:, column]) / np.diff(traj.t)
        mixed[1:-1, ident[1]] = (weight > SIDE) & (weight < 1.0 - SIDE)
    return mixed[1:-1], mixed[1:-1] & (mixed[2:] | mixed[:-2])


def evaluate_or_nan(f, t, x, *signs) -> np.ndarray:
    """A switch or field at a point where the run need not have been; no number where it raises."""
    try:
        return np.asarray(f(t, x.copy(), *signs), float)
    except Exception:
        return np.array(np.nan)


def check_start_in_layer(case: Case, width: float) -> str:
    """Whether the start is within `width` of a surface that both fields leave: a layer so thick
    decides for it; "" if not."""
    if not case.unique:
        return ""
    switch = as_numpy(case.problem.switch)
    field = as_numpy(case.problem.field)
    t = case.t[0]
    x = case.x0
    with np.errstate(all="ignore"):
        c = evaluate_or_nan(switch, t, x)
        for i in np.flatnonzero(np.abs(c) < width):
            plus, minus = one_sided_rates(switch, field, t, x, i, STEP * (case.t[-1] - t))
            if plus > 0.0 > minus:
                return (
                    f"The start is {abs(c[i]):.2g} from surface {i}, which both fields leave, "
                    f"and in its layer"
                )
    return ""


def switch_range(switch, t: float, X: np.ndarray, least: float = 0.0) -> np.ndarray:
    """(d,) by how much each switch changes at the end (t, X[-1]) of a run where a coordinate
    changes by as much as any does in it, or by `least`."""
    x = X[-1]
    ways = max(float(np.abs(X - X[0]).max()), float(np.abs(X).max()), least) * np.eye(x.size)
    here = evaluate_or_nan(switch, t, x)
    largest = np.zeros_like(here)
    for e in ways:
        for s in (1.0, -1.0):
            largest = np.fmax(largest, np.abs(evaluate_or_nan(switch, t, x + s * e) - here))
    return largest


def one_sided_rates(switch, field, t, x, i, dt) -> tuple[float, float]:
    """Rates of switch i in the fields of its positive and its negative side, other signs as they
    are."""
    plus, minus = (rates_in_sector(switch, field, t, x, [i], [side], dt)[0] for side in (1.0, -1.0))
    return plus, minus


def rates_in_sector(switch, field, t, x, rows, sides, dt) -> np.ndarray:
    """Rates of the switches `rows` in the field of these sides of theirs, other signs as they
    are."""
    signs = np.where(evaluate_or_nan(switch, t, x) >= 0.0, 1.0, -1.0)
    signs[rows] = sides
    f = evaluate_or_nan(field, t, x, signs)
    change = evaluate_or_nan(switch, t + dt, x + dt * f) - evaluate_or_nan(
        switch, t - dt, x - dt * f
    )
    return change.ravel()[rows] / (2.0 * dt) if change.ndim else np.full(len(rows), np.nan)
