"""Checks: starts and two-folds from which several solutions continue.

Where the fields of more than one side of a surface lead outward, each of them begins a solution. A
run reaches such a point at its start, or at the end of a slide if the fields of both sides turn
outward at one time: a two-fold (Filippov 1988, section 10; Jeffrey, SIAM J. Applied Dynamical
Systems 10, 2011).
"""

from __future__ import annotations

import numpy as np

from nsbench.case.scale import time_text
from nsbench.diagnostics.base import Finding
from nsbench.diagnostics.filippov.repulsive_surface import CLEAR_RATE, MAX_SURFACES
from nsbench.diagnostics.run_view import RunView, polygon, thin_samples, zero_between
from nsbench.dynamics.filippov.modes import sign_patterns
from nsbench.dynamics.filippov.switch_rates import (
    STEP,
    evaluate_or_nan,
    rates_in_sector,
    rounding_of_switches,
    sliding_intervals,
)

# of the time between two known states: turns of two fields that are as near coincide
AT_ONE_TIME = 1e-2
# steps in an interval, at least: so many that the mean weights of alternating sides are smooth
STEPS_PER_INTERVAL = 32.0


def check_nonunique_start(run: RunView) -> Finding | None:
    """Find a start on surfaces from which the fields of two sectors or more lead into their own.

    Each of them begins a solution. Cases that are declared not unique are not checked.
    """
    case = run.case
    if not case.unique:
        return None
    t = case.t[0]
    x = case.x0
    noise = rounding_of_switches(run.switch, t, x, np.abs(x))
    rows = np.flatnonzero(np.abs(evaluate_or_nan(run.switch, t, x)) <= noise)
    dt = STEP * (case.t[-1] - t)
    if not 0 < rows.size <= MAX_SURFACES:
        return None
    sectors = sign_patterns(rows.size)
    rates = np.array([rates_in_sector(run.switch, run.field, t, x, rows, s, dt) for s in sectors])
    clear = np.fmax(CLEAR_RATE * np.fmax.reduce(np.abs(rates), axis=0), noise[rows] / dt)
    if np.all(rates * sectors > clear, axis=1).sum() < 2:
        return None
    return Finding(
        "degenerate",
        f"The start is on surface {', '.join(map(str, rows))}, from which the fields of more than "
        "one side lead away: more than one motion begins there.",
    )


def check_two_fold(run: RunView) -> Finding | None:
    """Find a two-fold: both fields turn outward at one time on a surface that the run slides on.

    Many solutions continue from there. Where one field turns first, the run leaves to its side, and
    that is the solution. Intervals in which the run slides on another surface too are not checked:
    the one-sided fields are not those of its motion. Nor are cases that are declared not unique.
    """
    if not run.case.unique or len(run.t) < 3:
        return None
    # explicit steps alternate between the sides: weights are means over some of them
    chosen = thin_samples(run.t, STEPS_PER_INTERVAL * run.explicit_step)
    t = run.t[chosen]
    X = run.x[chosen]
    contacts = run.trajectory.contacts
    d = len(run.switch(t[0], X[0].copy()))
    mixed, slides = sliding_intervals(t, contacts, run.impulse[chosen], d)
    noise = rounding_of_switches(run.switch, t[-1], X[-1], np.abs(X).max(axis=0))
    noise = noise / run.difference_step
    for row in {ident[1] for ident in contacts}:
        alone = mixed[:, row] & ~np.delete(slides, row, axis=1).any(axis=1)
        if not alone.any():
            continue
        rates = np.array([run.one_sided_rates(k, row) for k in chosen])
        largest = float(np.fmax.reduce(np.abs(rates), axis=None, initial=0.0))
        clear = max(CLEAR_RATE * largest, noise[row])
        inward = (rates[:, 0] < -clear) & (rates[:, 1] > clear)
        outward = (rates[:, 0] > clear) & (rates[:, 1] < -clear)
        for k in np.flatnonzero(alone & inward[:-1]):
            # a known state may lie where the fields turn: the one behind it counts too
            for end in (j for j in (k + 1, k + 2) if j < len(t) and outward[j]):
                finding = _common_turn(run, row, polygon(t, X), t[k], t[end])
                if finding:
                    return finding
    return None


def _common_turn(run, row, state, low, high) -> Finding | None:
    """Look for a time between two others at which the rates of both sides change their sign."""
    rates = lambda at: run.rates_at(at, state(at), row)
    plus, minus = (
        zero_between(lambda at, side=side: rates(at)[side], low, high) for side in (0, 1)
    )
    if abs(plus - minus) > AT_ONE_TIME * (high - low):
        return None
    return Finding(
        "degenerate",
        f"At t = {time_text(plus, 6)} both fields turn away from surface {row}, on which the state "
        "slides: "
        "it may leave to either side at any time.",
    )
