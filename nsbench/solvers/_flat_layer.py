"""Layers around surfaces, of penalties and of tolerances, where a switch is flat: there they are thicker than they say."""
from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.solvers._sliding import Motion

THICK = 0.1             # of the largest slope of a switch: there its layer is ten times as thick, and thicker as it is refined
POINTS = 100            # of a run that are looked at, at least its samples
HALVINGS = 50


def flat_layer(case: Case, width: float, X: np.ndarray) -> str:
    """Where a run of a Filippov system, on the straight ways between its samples, is within `width` of a surface or passes it
    where its switch is flat, so that what is hidden below `width` is no small length; "" if it is nowhere."""
    motion = Motion(case.problem, float(case.t[0]), X[0].copy())
    rows, parts = np.arange(motion.d), -(-POINTS // (len(X) - 1))
    times = np.append((case.t[:-1, None] + np.diff(case.t)[:, None] * np.arange(parts) / parts).ravel(), case.t[-1])
    state = lambda t: np.array([np.interp(t, case.t, column) for column in X.T])
    with np.errstate(all="ignore"):
        c = np.array([motion.switch(float(t), x) for t, x in zip(times, state(times).T, strict=True)])
        passed = np.argwhere(c[1:] * c[:-1] < 0.0)
        met = np.array([_between(lambda t, i=i: motion.switch(t, state(t))[i], times[k], times[k + 1]) for k, i in passed])
        slope = lambda t: np.linalg.norm(motion.gradients(float(t), state(t), rows), axis=1)
        steep = np.array([slope(t) for t in (times if (np.abs(c) < width).any() else case.t)])
        flat = THICK * steep.max(axis=0)
        found = [(t, i, slope(t)[i]) for t, (_, i) in zip(met, passed, strict=True)]
        if len(steep) == len(times):
            found += [(times[k], i, steep[k, i]) for k, i in np.argwhere(np.abs(c) < width)]
    for at, row, value in sorted(found):
        if value < flat[row]:
            return (f"At t = {at:.6g} the state is in the layer of surface {row} where its switch is flat (a slope of "
                    f"{value:.2g}, elsewhere {steep[:, row].max():.2g})")
    return ""


def _between(f, low: float, high: float) -> float:
    """A zero of f between two times at which it has different signs."""
    positive = f(low) > 0.0
    for _ in range(HALVINGS):
        mid = 0.5 * (low + high)
        low, high = (mid, high) if (f(mid) > 0.0) == positive else (low, mid)
    return 0.5 * (low + high)
