"""Slides that end late: one field turns away from a surface to which the other hardly leads, and a
method is still beside it."""

from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.compilation.factories import as_numpy
from nsbench.diagnostics.bisection import zero_between
from nsbench.diagnostics.filippov.nonunique_motion import AT_ONCE
from nsbench.diagnostics.filippov.repulsive_surface import (
    STEP,
    one_sided_rates,
    rounding,
    sliding_intervals,
)
from nsbench.diagnostics.run_view import ways
from nsbench.trajectory import Trajectory

# of the largest rate with which the field that turns led to the surface: the other leads by less
FAINT = 1e-2
SOME = 8  # states from which the pace across a surface is taken
BOTH = 1e-12  # of the run: less is no step, but what is left of their sum
LAG = (
    10.0  # times r of width w (see late) may be sqrt(w s): the error still falls like w in the end
)


def check_late_exit(case: Case, traj: Trajectory, step: float = 0.0, width: float = 0.0) -> str:
    """Where a run leaves a surface later than its claim says; "" if nowhere.

    Let the rate of a switch in the field of one side pass through 0 with slope s, from leading to
    the surface to leading away, while that of the other side leads to it with a rate r: the state
    leaves then. An explicit step h that it made over the surface before takes the other field h
    |rate| / r to lead back from, and rates are s times the time that is left: with h s > r it does
    not come back in time, however little h is missing. In a layer of width w the weights follow in
    the time w / r, while the rate changes by r within r / s: with w s > r^2 they lag behind, by
    about sqrt(w / s), and where that is many times more the error falls like this alone.
    traj has the states that are known between samples too. Not looked at where it slides on another
    surface.
    """
    if not case.unique or len(traj.t) < 2:
        return ""
    switch = as_numpy(case.problem.switch)
    field = as_numpy(case.problem.field)
    dt = STEP * (traj.t[-1] - traj.t[0])
    t = traj.t
    X = traj.x
    state = ways(t, X)
    c = np.array([switch(at, x.copy()) for at, x in zip(t, X, strict=True)])
    _, slid = sliding_intervals(traj, c.shape[1])
    noise = rounding(switch, t[-1], X[-1], np.abs(X).max(axis=0)) / dt
    for i, weight in zip((ident[1] for ident in traj.contacts), traj.impulse.T, strict=True):
        alone = np.flatnonzero(~np.delete(slid, i, axis=1).any(axis=1))
        rates = lambda k, i=i: (
            np.array(one_sided_rates(switch, field, t[k], X[k], i, dt)) * (-1.0, 1.0)
        )
        pace = max(
            (
                np.fmax.reduce(np.abs(rates(k)), initial=0.0)
                for k in alone[:: -(-len(alone) // SOME) or 1]
            ),
            default=0.0,
        )
        near = alone[np.abs(c[alone, i]) <= max(2.0 * width, step * pace)]
        led = np.full((len(t) + 1, 2), np.nan)
        for k in np.unique(np.add.outer(near, (0, 1, 2)).clip(max=len(t) - 1)):
            led[k] = rates(k)
        beside = np.isin(np.arange(len(t)), near)[:, None]
        most = np.fmax.accumulate(np.where(beside, led[:-1], 0.0))
        both = np.minimum(weight, t - t[0] - weight)[:, None] > BOTH * (
            t[-1] - t[0]
        )  # sides have been made use of
        for k, side in np.argwhere(beside & both & (led[:-1] > noise[i])):
            end = next((j for j in (k + 1, min(k + 2, len(t))) if led[j, side] < -noise[i]), None)
            if end is None:  # one may lie where it turns
                continue
            here = lambda at, i=i: one_sided_rates(switch, field, at, state(at), i, dt)
            turn, also = (
                zero_between(lambda at, side=s, here=here: here(at)[side], t[k], t[end])
                for s in (side, 1 - side)
            )
            if led[end, 1 - side] < -noise[i] and abs(also - turn) <= AT_ONCE * (t[end] - t[k]):
                continue  # a two-fold
            other = here(turn)[1 - side] * (-1.0, 1.0)[1 - side]
            sharp = (led[k, side] - led[end, side]) / (t[end] - t[k])
            if (
                noise[i]
                < other
                < min(FAINT * most[k, side], max(step * sharp, np.sqrt(width * sharp) / LAG))
            ):
                return (
                    f"At t = {turn:.6g} one field turns away from surface {i}, to which the other "
                    f"leads at {other:.2g} "
                    "alone: the state stays beside it for longer"
                )
    return ""
