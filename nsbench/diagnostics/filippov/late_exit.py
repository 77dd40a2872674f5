"""Checks: a sliding surface is left later than the error claim of the method allows.

Sliding on surface i ends at the time t* at which the rate dc_i/dt in the field of one side passes
from inward to outward, with slope s, while the other side still leads inward with rate r > 0. If r
is small, a numerical solution stays near the surface after t*:

    explicit steps h     A step over the surface is led back in h |rate| / r. Rates are s times the
                         time that is left: with h s > r the state does not come back in time,
                         however little is missing.
    a layer of width w   Weights follow in the time w / r, while the rate changes by r within r / s:
                         with w s > r^2 they lag, by about sqrt(w / s). Where that is many times w /
                         r, the error falls like sqrt(w) alone.

Only exits with r < FAINT_RETURN times the largest inward rate before are examined, and only where
the run slides on no other surface.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from nsbench.case.scale import time_text
from nsbench.diagnostics.base import Finding
from nsbench.diagnostics.filippov.nonunique_motion import AT_ONE_TIME
from nsbench.diagnostics.run_view import RunView, zero_between
from nsbench.dynamics.filippov.switch_rates import rounding_of_switches

# r over the largest inward rate of the field that turns: above it both delays are below the claims
FAINT_RETURN = 1e-2
SAMPLED_STATES = 8  # from which the speed across a surface is estimated
SIDE_USED = 1e-12  # of the time of a run: integral of a weight that is no rounding of a sum
LAYER_LAG = 10.0  # times w / r, to which sqrt(w / s) may grow: the error still falls like w then
INWARD = np.array((-1.0, 1.0))  # signs of an inward rate on the positive and the negative side


def check_late_exit(run: RunView) -> Finding | None:
    """Find a slide that explicit steps leave later than their error claim allows.

    One field turns outward while the other hardly leads inward: h times the slope of the turning
    rate is more than the inward rate.
    """
    step = run.explicit_step
    where = next(_late_exits(run, step, 0.0), "") if step else ""
    return (
        Finding("unverified", f"{where}: no error of size h is claimed there.") if where else None
    )


def check_late_exit_from_layer(run: RunView) -> Finding | None:
    """Find a slide that a regularisation layer leaves later than its error claim allows.

    One field turns outward while the other hardly leads inward: the sliding weight lags behind by
    the square root of the width of the layer.
    """
    width = run.resolution.layer
    where = next(_late_exits(run, 0.0, width), "") if width else ""
    return (
        Finding("unverified", f"{where}: no error of size 1 / k is claimed there.")
        if where
        else None
    )


def _late_exits(run: RunView, step: float, width: float) -> Iterator[str]:
    """Yield a clause for each exit that is late for explicit steps, or for a layer of `width`."""
    if not run.case.unique or len(run.t) < 2:
        return
    t = run.t
    noise = rounding_of_switches(run.switch, t[-1], run.x[-1], np.abs(run.x).max(axis=0))
    noise = noise / run.difference_step
    for i, weight in zip(
        (ident[1] for ident in run.trajectory.contacts), run.impulse.T, strict=True
    ):
        near = _states_near_surface(run, i, step, width)
        inward = np.full((len(t) + 1, 2), np.nan)  # rates, positive if inward; NaN where not needed
        for k in np.unique(np.add.outer(near, (0, 1, 2)).clip(max=len(t) - 1)):
            inward[k] = run.one_sided_rates(k, i) * INWARD
        is_near = np.isin(np.arange(len(t)), near)[:, None]
        largest = np.fmax.accumulate(np.where(is_near, inward[:-1], 0.0))
        used = np.minimum(weight, t - t[0] - weight)[:, None] > SIDE_USED * (t[-1] - t[0])
        for k, side in np.argwhere(is_near & used & (inward[:-1] > noise[i])):
            # a known state may lie where the field turns: the one behind it counts too
            ends = (k + 1, min(k + 2, len(t)))
            end = next((j for j in ends if inward[j, side] < -noise[i]), None)
            if end is None:
                continue
            slope = (inward[k, side] - inward[end, side]) / (t[end] - t[k])
            delay = max(step * slope, np.sqrt(width * slope) / LAYER_LAG)
            limit = min(FAINT_RETURN * largest[k, side], delay)
            both_turn = inward[end, 1 - side] < -noise[i]
            turn, other = _turning_time(run, i, side, t[k], t[end], both_turn)
            if turn is not None and noise[i] < other < limit:
                yield (
                    f"At t = {time_text(turn, 6)} one field turns away from surface {i}, to which "
                    "the other "
                    f"leads at {other:.2g} alone: the state stays beside it for longer"
                )


def _states_near_surface(run: RunView, i: int, step: float, width: float) -> np.ndarray:
    """Return the known states within two layers, or about a step, of surface i.

    Only those in whose interval the run slides on no other surface; the length of a step across the
    surface is estimated from the largest rate at SAMPLED_STATES of them.
    """
    alone = np.flatnonzero(~np.delete(run.slides, i, axis=1).any(axis=1))
    sampled = alone[:: -(-len(alone) // SAMPLED_STATES) or 1]
    speed = max(
        (np.fmax.reduce(np.abs(run.one_sided_rates(k, i) * INWARD), initial=0.0) for k in sampled),
        default=0.0,
    )
    return alone[np.abs(run.switches[alone, i]) <= max(2.0 * width, step * speed)]


def _turning_time(run, i, side, low, high, both_turn):
    """Return the time at which the rate of a side turns, and the inward rate of the other then.

    (None, 0.0) at a two-fold: both_turn, and both do so at one time.
    """
    rates = lambda at: run.rates_at(at, run.state(at), i)
    turn, other_turn = (
        zero_between(lambda at, side=s: rates(at)[side], low, high) for s in (side, 1 - side)
    )
    if both_turn and abs(other_turn - turn) <= AT_ONE_TIME * (high - low):
        return None, 0.0
    return turn, rates(turn)[1 - side] * INWARD[1 - side]
