"""Starts, and slides, from which more than one motion goes on: fields of more than one side lead
away to that side."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np

from nsbench.case import Case
from nsbench.compilation.factories import as_numpy
from nsbench.diagnostics.bisection import zero_between
from nsbench.diagnostics.filippov.repulsive_surface import (
    CLEAR,
    MEET,
    STEP,
    evaluate_or_nan,
    one_sided_rates,
    rates_in_sector,
    rounding,
    sliding_intervals,
)
from nsbench.diagnostics.run_view import ways
from nsbench.dynamics.filippov.modes import LONG, thin_samples
from nsbench.trajectory import Status, Trajectory

AT_ONCE = 1e-2  # of the time between two known states: as near both fields turn at once


def check_nonunique_start(case: Case) -> Status | None:
    """degenerate, if the start is where surfaces are, up to MEET, and the fields of two sectors or
    more lead each into its own:
    each of them is the beginning of a solution. None for cases that say so of themselves."""
    if not case.unique:
        return None
    switch = as_numpy(case.problem.switch)
    field = as_numpy(case.problem.field)
    t = case.t[0]
    x = case.x0
    noise = rounding(switch, t, x, np.abs(x))
    rows = np.flatnonzero(np.abs(evaluate_or_nan(switch, t, x)) <= noise)
    dt = STEP * (case.t[-1] - t)
    if not 0 < rows.size <= MEET:
        return None
    sectors = np.array(list(product((1.0, -1.0), repeat=rows.size)))
    led = np.array([rates_in_sector(switch, field, t, x, rows, s, dt) for s in sectors])
    if (
        np.all(
            led * sectors > np.fmax(CLEAR * np.fmax.reduce(np.abs(led), axis=0), noise[rows] / dt),
            axis=1,
        ).sum()
        < 2
    ):
        return None
    return Status(
        "degenerate",
        f"The start is on surface {', '.join(map(str, rows))}, from which the fields of more than "
        f"one "
        "side lead away: more than one motion begins there.",
    )


def check_two_fold(case: Case, traj: Trajectory) -> Status | None:
    """degenerate, if a run slides on a surface to which both fields lead, and both turn away at one
    time: a two-fold, from which many solutions go on (Filippov 1988, section 10; Jeffrey, SIAM J.
    Applied Dynamical Systems 10, 2011). Where one turns first, the run leaves to its side, and that
    is the solution. None for cases that say so of themselves. Not looked at where it slides on
    another surface too: the fields beside that one are not those it moves in.
    """
    if not case.unique or len(traj.t) < 3:
        return None
    switch = as_numpy(case.problem.switch)
    field = as_numpy(case.problem.field)
    dt = STEP * (traj.t[-1] - traj.t[0])
    # the sides of explicit steps alternate: their weights are of some
    keep = thin_samples(
        traj.t, LONG * float(traj.stats.get("h") or 0.0) if traj.lam_time == "start" else 0.0
    )
    t = traj.t[keep]
    X = traj.x[keep]
    state = ways(t, X)
    mixed, slid = sliding_intervals(
        replace(traj, t=t, x=X, impulse=traj.impulse[keep]), len(switch(t[0], X[0].copy()))
    )
    noise = rounding(switch, t[-1], X[-1], np.abs(X).max(axis=0)) / dt
    for row in {ident[1] for ident in traj.contacts}:
        slides = mixed[:, row] & ~np.delete(slid, row, axis=1).any(axis=1)
        if not slides.any():
            continue
        led = np.array(
            [one_sided_rates(switch, field, at, x, row, dt) for at, x in zip(t, X, strict=True)]
        )
        clear = max(CLEAR * float(np.fmax.reduce(np.abs(led), axis=None, initial=0.0)), noise[row])
        to = (led[:, 0] < -clear) & (led[:, 1] > clear)
        off = (led[:, 0] > clear) & (led[:, 1] < -clear)
        for k in np.flatnonzero(slides & to[:-1]):
            for end in (
                j for j in (k + 1, k + 2) if j < len(t) and off[j]
            ):  # a state may lie where they turn
                here = lambda at, row=row: one_sided_rates(switch, field, at, state(at), row, dt)
                plus, minus = (
                    zero_between(lambda at, side=side, here=here: here(at)[side], t[k], t[end])
                    for side in (0, 1)
                )
                if abs(plus - minus) <= AT_ONCE * (t[end] - t[k]):
                    return Status(
                        "degenerate",
                        f"At t = {plus:.6g} both fields turn away from surface {row}, on which the "
                        "state slides: it may leave to either side at any time.",
                    )
    return None
