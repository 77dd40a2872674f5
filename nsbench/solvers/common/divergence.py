"""What it means that a march with fixed steps stopped because its state was not finite."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nsbench.solvers.base import Grid
from nsbench.trajectory import Status

GROWN = (
    1e6  # over the start's size, or 1: a state that is larger was not thrown there by one bad value
)
ROOM = 10**7  # numbers: what is kept of the steps that are taken again


def classify_divergence(
    g: Grid, X: np.ndarray, reached: float, again: Callable[[Grid, np.ndarray], np.ndarray] | None
) -> Status:
    """diverged, where the state had grown beyond GROWN before it was lost, else nan; X (K, n)
    samples, NaN where there is none.

    The steps between the last sample and the end are taken once more, each of them a sample:
    again(grid, x) -> X. None:
    the samples alone decide.
    """
    k = int(np.isfinite(X).all(axis=1).sum()) - 1
    n = int(g.substeps[min(k, len(g.substeps) - 1)])
    seen = X[: k + 1]
    when = g.t[k]
    if again is not None and k + 1 < len(g.t) and n * X.shape[1] <= ROOM:
        nodes = np.linspace(g.t[k], g.t[k + 1], n + 1)
        fine = again(Grid(nodes, np.ones(n, np.int64), g.h, True), X[k].copy())
        whole = np.isfinite(fine).all(axis=1)
        seen = np.concatenate([seen, fine[whole]])
        when = nodes[int(whole.sum()) - 1]
    return ended(seen, X[0], reached, when)


def ended(seen: np.ndarray, start: np.ndarray, reached: float, when: float) -> Status:
    """The status of a march whose states `seen`, the last at `when`, were followed by one that is
    not finite."""
    size = float(np.abs(seen).max(initial=0.0))
    if size > GROWN * max(1.0, float(np.abs(start).max(initial=0.0))):
        return Status(
            "diverged",
            f"The state grew to {size:.3g} at t = {when:.6g}, and then beyond all bounds; a "
            f"smaller step "
            "may help.",
        )
    return Status(
        "nan",
        f"The state stopped being finite at t = {reached:.6g}: the drift is not finite there "
        "or the step is too long for it.",
    )
