"""Layers around surfaces, of penalties and of tolerances, where a switch is flat: there they are
thicker than they say."""

from __future__ import annotations

from itertools import product

import numpy as np

from nsbench.case import Case
from nsbench.compilation.factories import as_numpy
from nsbench.diagnostics.bisection import zero_between
from nsbench.diagnostics.filippov.repulsive_surface import evaluate_or_nan, switch_range
from nsbench.diagnostics.run_view import ways
from nsbench.dynamics.filippov.vector_field import FilippovVectorField

# of a slope within the layer that it gives: there the layer is of another thickness than it says
CHANGES = 0.5
POINTS = 100  # of a run that are looked at, at least its samples
UNKNOWN = 4  # other switches in their layers of which both signs are tried


def check_flat_switch(case: Case, width: float, t: np.ndarray, X: np.ndarray) -> str:
    """Where a run of a Filippov system, on the straight ways between its states X at times t, is
    within `width` of a surface or passes it where its switch is so flat that what is hidden below
    `width` is no length of `width` / slope; "" if it is nowhere."""
    motion = FilippovVectorField(case.problem, float(case.t[0]), X[0].copy())
    rows = np.arange(motion.d)
    times = _looks(t)
    state = ways(t, X)
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
            gradient = motion.gradients(float(at), x, rows)[row]
            slope = float(np.linalg.norm(gradient))
            beside = (
                [
                    float(
                        np.linalg.norm(
                            motion.gradients(
                                float(at), x + side * width / slope**2 * gradient, rows
                            )[row]
                        )
                    )
                    for side in (1.0, -1.0)
                ]
                if slope > 0.0
                else [np.inf]
            )
            if (
                np.abs(motion.along(float(at), x, 1.0, 0.0 * x))[row] * (t[-1] - t[0])
                > slope * np.abs(X).max()
            ):
                continue  # a surface in time, which does not wait for the state
            if max(abs(b - slope) for b in beside) > CHANGES * slope:
                return (
                    f"At t = {at:.6g} the state is in the layer of surface {row} where its switch "
                    f"is flat (a slope of "
                    f"{slope:.2g})"
                )
    return ""


def _looks(t: np.ndarray) -> np.ndarray:
    """At least POINTS times, all samples t among them."""
    parts = -(-POINTS // (len(t) - 1))
    return np.append((t[:-1, None] + np.diff(t)[:, None] * np.arange(parts) / parts).ravel(), t[-1])


def check_never_leaves_layer(case: Case, width: float, t: np.ndarray, X: np.ndarray) -> str:
    """Which switch that a field depends on, at one of POINTS times or more, is in its layer at all
    of them, and would be wherever the states' own size could take it; "" if none is."""
    with np.errstate(all="ignore"):
        switch = as_numpy(case.problem.switch)
        field = as_numpy(case.problem.field)
        times = _looks(t)
        states = ways(t, X)(times).T
        c = np.array([switch(float(at), x.copy()) for at, x in zip(times, states, strict=True)])
        over = np.fmax(switch_range(switch, float(t[-1]), X), np.ptp(c, axis=0))
        for i in np.flatnonzero((np.abs(c).max(axis=0) < width) & (0.0 < over) & (over < width)):
            one = np.arange(c.shape[1]) == i
            for at, x, row in zip(times, states, c, strict=True):
                if any(
                    not np.array_equal(
                        evaluate_or_nan(field, at, x, np.where(one, 1.0, s)),
                        evaluate_or_nan(field, at, x, np.where(one, -1.0, s)),
                        equal_nan=True,
                    )
                    for s in _sides(row, (np.abs(row) < width) & ~one)
                ):
                    return (
                        f"Switch {i} does not leave its layer: it changes by no more than "
                        f"{over[i]:.2g}"
                    )
    return ""


def _sides(c: np.ndarray, unknown: np.ndarray) -> list:
    """The signs of the switches c (d,), with all those of the first few unknown ones."""
    signs = np.where(c >= 0.0, 1.0, -1.0)
    open_ = np.flatnonzero(unknown)[:UNKNOWN]
    out = []
    for some in product((1.0, -1.0), repeat=open_.size):
        out.append(signs.copy())
        out[-1][open_] = some
    return out
