"""Errors of the multipliers of single steps, compared at the start, middle and end of a step.

A step of length h that ends at a sample has one multiplier: its impulse divided by h
(Trajectory.lam). It is compared with the exact multiplier at the start, the middle and the end of
that step and with its mean over the step; which of the four is right belongs to the method
(Trajectory.lam_time). A method may be of order two at its own label and of order one at all others:
|lambda'| h / 2 is what half a step costs. Methods without steps (label "mean") have their mean over
the sample interval taken for the step.

The exact multiplier at a time is the derivative of `exact_impulse`, by central differences of order
eight at four spacings; the two that agree best are taken, and what they differ by is the error.
Samples count whose interval lies outside the windows around events, so that nothing jumps within
the differences, which reach one sample spacing.
"""

from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.measure.context import MeasureContext
from nsbench.reference import columns_of, listed_contacts, spread
from nsbench.trajectory import Trajectory

NAMES = ("lam_own", "lam_at_start", "lam_at_mid", "lam_at_end", "lam_mean")
PLACES = {"lam_at_start": 1.0, "lam_at_mid": 0.5, "lam_at_end": 0.0}  # steps before the sample
OWN = {"start": "lam_at_start", "midpoint": "lam_at_mid", "end": "lam_at_end", "mean": "lam_mean"}
WEIGHTS = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])  # central differences of order eight
SPACINGS = (1 / 4, 1 / 8, 1 / 16, 1 / 32)  # of their nodes, in sample spacings


def exact_multiplier(case: Case, t: np.ndarray, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Differentiate exact_impulse at the times t (k,), within one spacing of the samples.

    Returns the exact multipliers (k, m) and estimates of their error.
    """
    guesses = []
    for part in SPACINGS:
        d = part * spacing
        guesses.append(
            sum(
                w / d * (_impulse(case, t + j * d) - _impulse(case, t - j * d))
                for j, w in enumerate(WEIGHTS, 1)
            )
        )
    guesses = np.array(guesses)
    apart = np.abs(np.diff(guesses, axis=0))
    best = apart.argmin(axis=0)[None]
    return np.take_along_axis(guesses[1:], best, 0)[0], np.take_along_axis(apart, best, 0)[0]


def _impulse(case: Case, t: np.ndarray) -> np.ndarray:
    """Evaluate the exact impulse (k, m) at the times t (k,)."""
    return np.asarray(case.exact_impulse(t), float)


def errors_at_times(made: MeasureContext, traj: Trajectory) -> dict:
    """Measure the largest errors of step multipliers at each time in the step.

    Returns {} where there is nothing to compare. lam_floor: ten times the error of the exact
    multiplier.
    """
    case = made.case
    t = made.case.t
    if case.exact_impulse is None or (traj.lam is None and traj.lam_time != "mean"):
        return {}
    h = traj.lam_h
    lam = traj.lam
    if lam is None:
        h = np.append(np.nan, np.diff(t))
        lam = np.vstack(
            [
                np.full(traj.impulse.shape[1], np.nan),
                np.diff(traj.impulse, axis=0) / np.diff(t)[:, None],
            ]
        )
    spacing = float(np.diff(t).min())
    k = 1 + np.flatnonzero(made.quiet)
    k = k[
        (t[k] - h[k] - spacing >= t[0])
        & (t[k] + spacing <= t[-1])
        & np.all(np.isfinite(lam[k]), axis=1)
    ]
    if not k.size:
        return {}
    ids = tuple(case.contacts) if case.contacts is not None else listed_contacts(case)
    columns = columns_of(case.problem, traj.contacts, ids)
    mine = spread(case.problem, traj.contacts, lam[k], columns)
    theirs = lambda values: spread(case.problem, ids, values, columns)
    out = {}
    floor = 0.0
    for name, part in PLACES.items():
        exact, error = exact_multiplier(case, t[k] - part * h[k], spacing)
        out[name], floor = _largest(mine - theirs(exact)), max(floor, _largest(error))
    mean = (_impulse(case, t[k]) - _impulse(case, t[k] - h[k])) / h[k][:, None]
    out["lam_mean"] = _largest(mine - theirs(mean))
    return out | {"lam_own": out[OWN[traj.lam_time]], "lam_floor": 10.0 * floor}


def _largest(values) -> float:
    """Return the largest modulus, 0 if there are no values."""
    return float(np.abs(values).max(initial=0.0))
