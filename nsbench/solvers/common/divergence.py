"""Classify a run with fixed steps whose state stopped being finite: diverged, or not a number."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nsbench.case.scale import size_text, time_text
from nsbench.solvers.base import Grid
from nsbench.trajectory import Status

# largest state over that of the start, or over 1; beyond it, no single bad value is the cause
GROWTH_OF_DIVERGENCE = 1e6
MAX_STORED_NUMBERS = 10**7  # of the steps that are taken once more


def classify_divergence(
    g: Grid, X: np.ndarray, reached: float, again: Callable[[Grid, np.ndarray], np.ndarray] | None
) -> Status:
    """Return the status "diverged" if the state had grown by 1e6 before the end, else "nan".

    g: the grid; X (K, n): samples, NaN where there is none; reached: the time of the last step.
    again(grid, x) -> X: the same run from x; the steps between the last sample and the end are
    taken once more, each of them a sample. None: the samples alone decide.
    """
    k = int(np.isfinite(X).all(axis=1).sum()) - 1
    n = int(g.substeps[min(k, len(g.substeps) - 1)])
    states = X[: k + 1]
    when = g.t[k]
    if again is not None and k + 1 < len(g.t) and n * X.shape[1] <= MAX_STORED_NUMBERS:
        nodes = np.linspace(g.t[k], g.t[k + 1], n + 1)
        fine = again(Grid(nodes, np.ones(n, np.int64), g.h, True), X[k].copy())
        whole = np.isfinite(fine).all(axis=1)
        states = np.concatenate([states, fine[whole]])
        when = nodes[int(whole.sum()) - 1]
    return ended(states, X[0], reached, when)


def ended(states: np.ndarray, start: np.ndarray, reached: float, when: float) -> Status:
    """Return the status of a run whose states, the last at `when`, precede one that is not finite.

    states (m, n); start (n,); reached: the time of the step that failed.
    """
    size = float(np.abs(states).max(initial=0.0))
    if size > GROWTH_OF_DIVERGENCE * max(1.0, float(np.abs(start).max(initial=0.0))):
        return Status(
            "diverged",
            f"The state grew to {size_text(size)} at t = {time_text(when, 6)}, and then beyond all "
            "bounds; a "
            f"smaller step "
            "may help.",
        )
    return Status(
        "nan",
        f"The state stopped being finite at t = {time_text(reached, 6)}: the drift is not finite "
        "there "
        "or the step is too long for it.",
    )
