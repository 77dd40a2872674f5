"""Checks: runs that stay on, or start in the layer of, a surface that its fields leave.

Where the fields of both sides of a surface lead outward, the solution to the right is not unique: a
state on the surface may leave it to either side, and at any time (Filippov, Differential Equations
with Discontinuous Righthand Sides, 1988, section 10). The same holds where one leads outward and
the other side is at rest on the surface. A method that stays there has selected one of many
solutions.
"""

from __future__ import annotations

import numpy as np

from nsbench.case.scale import time_text
from nsbench.diagnostics.base import Finding
from nsbench.diagnostics.run_view import RunView
from nsbench.dynamics.filippov.modes import sign_patterns
from nsbench.dynamics.filippov.switch_rates import (
    STEP,
    evaluate_or_nan,
    one_sided_rates,
    rates_in_sector,
    rounding_of_switches,
    switch_range,
)

MIN_POINTS = 40  # of a run at which rates are taken, at least at its known states
ON_SURFACE = 1e-9  # of the largest value of a switch: a state this near may be on its surface
ONE_SIDED = 1e-9  # mean weight of a side below which a run was on the other side alone
AT_REST = 1e-9  # of the largest rate: what differences leave of a rate that is zero
# surfaces through one point: of more, the sectors are too many to be examined
MAX_SURFACES = 4
CLEAR_RATE = 1e-4  # of the largest rate: below it, the sign of a rate is not certain
BOTH = "both fields leave: it may leave to either side"
RESTS = "one field leaves, while the other leaves it at rest there: it may leave"


def check_repulsive_sliding(run: RunView) -> Finding | None:
    """Find a state that stays on a surface which both fields leave, or one if the other rests.

    It stays if it is on the surface at two known states in a row; rates are taken there and
    between. A run that was on one side alone meanwhile has not stayed but left and come back,
    unless that side is at rest. A surface that is reached between two known states, and by both
    fields, is examined at the second. Where surfaces meet, or are one, the field of a sector must
    lead into that sector. Cases that are declared not unique are not checked.
    """
    if not run.case.unique or len(run.t) < 2:
        return None
    c = run.switches
    size = np.maximum(np.abs(c).max(axis=0), switch_range(run.switch, run.t[-1], run.x))
    side = _single_sides(run)
    on = np.abs(c) <= ON_SURFACE * size
    # what fell onto a surface misses it by a rounding of its fall, and stands still there; what
    # decays to a surface is never on it
    exactly = _within_rounding(run, on, 0.0)
    fallen = _within_rounding(run, on, np.abs(run.x).max(axis=0))
    stands = (exactly[1:] & exactly[:-1]) | (fallen[1:] & fallen[:-1] & (c[1:] == c[:-1]))
    stayed = np.where(side == 0.0, on[1:] & on[:-1], stands)
    reached = ~stayed & fallen[1:] & (side == 0.0)
    parts = -(-MIN_POINTS // (len(run.t) - 1))
    for i in np.flatnonzero((stayed | reached).any(axis=0)):
        others = np.delete(run.slides, i, axis=1).any(axis=1)  # in layers, not on surfaces
        alone = (on[1:].sum(axis=1) == 1) & ~others
        spans = np.flatnonzero((stayed | reached)[:, i] & alone)
        finding = _examine_surface(run, i, spans, stayed[spans, i], side[spans, i], parts)
        if finding:
            return finding
    return _examine_corners(run, stayed, stayed | reached, on, parts)


def _within_rounding(run: RunView, on: np.ndarray, least) -> np.ndarray:
    """(K, d) bool: a state is on a surface to the rounding of coordinates of at least `least`."""
    out = []
    for row, near, t, x in zip(run.switches, on, run.t, run.x, strict=True):
        if near.any():
            noise = rounding_of_switches(run.switch, t, x, np.fmax(np.abs(x), least))
            out.append(np.abs(row) <= noise)
        else:
            out.append(near)
    return np.array(out)


def _examine_surface(run, i, spans, stayed, side, parts) -> Finding | None:
    """Look for outward rates of surface i in the intervals `spans` (S,), in `parts` of each.

    stayed (S,) bool: the state is on the surface at both ends of an interval, else at its second
    end. side (S,): the side whose field alone made the motion of an interval; 0: both.
    """
    fractions = np.arange(1, parts + 1) / parts
    times = [[(1.0 - a) * run.t[k] + a * run.t[k + 1] for a in fractions] for k in spans]
    rates = np.array(
        [
            [run.rates_at(t, _state_in_interval(run, k, t), i) for t in row]
            for k, row in zip(spans, times, strict=True)
        ]
    ).reshape(len(spans), parts, 2)
    last = np.arange(parts) == parts - 1
    rates[~(stayed[:, None] | last)] = np.nan
    rates /= max(1e-300, float(np.fmax.reduce(np.abs(rates), axis=None, initial=0.0)))
    plus = rates[..., 0]
    minus = rates[..., 1]
    side = side[:, None]
    for outward, what in (
        ((side == 0.0) & (plus > CLEAR_RATE) & (minus < -CLEAR_RATE), BOTH),
        ((side > 0.0) & (minus < -CLEAR_RATE) & _rests(plus), RESTS),
        ((side < 0.0) & (plus > CLEAR_RATE) & _rests(minus), RESTS),
    ):
        for row, part in np.argwhere(outward)[:1]:
            return Finding(
                "degenerate",
                f"At t = {time_text(times[row][part], 6)} the state is on surface {i}, which "
                f"{what} at any "
                "time.",
            )
    return None


def _examine_corners(run, stayed, held, on, parts) -> Finding | None:
    """Look for states on several surfaces where the field of a sector leads into that sector.

    stayed, held (K - 1, d) bool: on a surface at both ends of an interval; or at its second end.
    on (K, d) bool: on a surface at a known state.
    """
    dt = run.difference_step
    for k in np.flatnonzero((held.sum(axis=1) > 1) & np.all(held == on[1:], axis=1)):
        rows = np.flatnonzero(held[k])
        if rows.size > MAX_SURFACES:
            continue
        sectors = sign_patterns(rows.size)
        fractions = np.arange(1, parts + 1) / parts
        times = [(1.0 - a) * run.t[k] + a * run.t[k + 1] for a in fractions]
        states = [_state_in_interval(run, k, t) for t in times]
        rates = np.array(
            [
                [rates_in_sector(run.switch, run.field, t, x, rows, s, dt) for s in sectors]
                for t, x in zip(times, states, strict=True)
            ]
        )
        rates = rates.reshape(parts, len(sectors), rows.size)
        rates[: 0 if stayed[k, rows].all() else -1] = np.nan
        rates /= np.fmax(np.fmax.reduce(np.abs(rates), axis=(0, 1), initial=0.0), 1e-300)
        for part, _ in np.argwhere(np.all(rates * sectors > CLEAR_RATE, axis=2))[:1]:
            return Finding(
                "degenerate",
                f"At t = {time_text(times[part], 6)} the state is on surfaces "
                f"{', '.join(map(str, rows))}, "
                "and the field of a side leads to that side: it may leave at any time.",
            )
    return None


def _state_in_interval(run, k: int, t: float) -> np.ndarray:
    """Interpolate between the known states k and k + 1; exact at both, as surfaces need it."""
    a = (t - run.t[k]) / (run.t[k + 1] - run.t[k])
    return (1.0 - a) * run.x[k] + a * run.x[k + 1]


def _rests(rate) -> np.ndarray:
    """(S, 1) bool: the rates (S, parts) of a side vanish all the time of an interval."""
    return np.all(np.abs(rate) <= AT_REST, axis=1, keepdims=True)


def _single_sides(run: RunView) -> np.ndarray:
    """(K - 1, d) 1 or -1 where the field of that side alone made the motion of an interval.

    0 where both did, or where the weight is not known.
    """
    out = np.zeros((len(run.t) - 1, run.switches.shape[1]))
    for column, ident in enumerate(run.trajectory.contacts):
        weight = np.diff(run.impulse[:, column]) / np.diff(run.t)
        positive = np.where(weight > 1.0 - ONE_SIDED, 1.0, 0.0)
        out[:, ident[1]] = np.where(weight < ONE_SIDED, -1.0, positive)
    return out


def check_start_in_layer(run: RunView) -> Finding | None:
    """Find a start within the regularisation layer of a surface that both fields leave.

    The width of the layer decides to which side the state leaves. Cases that are declared not
    unique are not checked.
    """
    width = run.resolution.layer
    case = run.case
    if not case.unique or not width > 0.0:
        return None
    t = case.t[0]
    x = case.x0
    c = evaluate_or_nan(run.switch, t, x)
    for i in np.flatnonzero(np.abs(c) < width):
        dt = STEP * (case.t[-1] - t)
        plus, minus = one_sided_rates(run.switch, run.field, t, x, i, dt)
        if plus > 0.0 > minus:
            return Finding(
                "unverified",
                f"The start is {abs(c[i]):.2g} from surface {i}, which both fields leave, and in "
                "its layer: no error of size 1 / k is claimed there.",
            )
    return None
