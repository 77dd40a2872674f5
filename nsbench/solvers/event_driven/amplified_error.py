"""Check of event-driven runs: does the flow amplify their errors beyond what the method claims?

The method controls the error of a step, and the flow carries it on. Two runs whose tolerances
differ by a known factor differ by that factor times the error of the first, carried on: where the
flow amplifies errors, as in chaotic circuits, the difference shows it, and the claim does not hold.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nsbench.case import Case
from nsbench.diagnostics.base import ANY_PROBLEM, Check, Finding
from nsbench.diagnostics.run_view import RunView
from nsbench.error_bars import Bars, ErrorBars
from nsbench.solvers.base import Solver
from nsbench.trajectory import Trajectory

LOOSER = 16.0  # the tolerance of the second run over that of the first
CLAIM = 1e-10  # of the size of the state: what EventDriven claims at its default tolerance
DEFAULT = 1e-12
# Two runs whose errors are proportional to their tolerances differ by LOOSER - 1 errors of the
# tighter one; half as many are taken, as the proportion is a rough one.
ERRORS_APART = 0.5 * LOOSER
MOST_STEPS = 100_000  # of a run that is made a second time


class TolerancePair(ErrorBars):
    """Error bars from a pair of tolerances; tol: the tighter one."""

    def __init__(self, make: Callable[[], Bars], tol: float):
        super().__init__(make)
        self.tol = tol


def tolerance_pair(method: Solver, case: Case, traj: Trajectory, tol: float) -> TolerancePair:
    """Return error bars of a run from a second one with the tolerance LOOSER tol.

    They are the differences of both, which the error of the first is a part of.
    """
    return TolerancePair(lambda: _compared(method, case, traj, tol), tol)


def _compared(method, case, traj, tol) -> Bars:
    if traj.stats.get("steps", 0) > MOST_STEPS or LOOSER * tol >= 1e-2:
        return Bars.none(traj.t, "No second run was made to compare with.")
    other = method.prepare(case, LOOSER * tol)()
    if not other.status.ok:
        return Bars.none(traj.t, f"A run with a looser tolerance ended: {other.status}")
    state = np.linalg.norm(traj.x - other.x, axis=1)
    nothing = np.full(len(traj.t), np.nan)
    reaction = nothing
    if traj.reaction.size and traj.reaction.shape == other.reaction.shape:
        reaction = np.linalg.norm(traj.reaction - other.reaction, axis=1)
    return Bars(traj.t, state, reaction, nothing)


def check_amplified_error(run: RunView) -> Finding | None:
    """Find runs whose errors the flow amplifies beyond the error that the method claims.

    The run is compared with one of a looser tolerance: it is doubted where they differ by more than
    the claim makes them differ, relative to the size of the state. At a larger tolerance the claim
    is as many times larger.
    """
    bars = run.trajectory.bound
    if not isinstance(bars, TolerancePair) or not np.all(np.isfinite(bars.state)):
        return None
    claim = CLAIM * max(1.0, bars.tol / DEFAULT)
    found = float(np.max(bars.state)) / max(1.0, float(np.abs(run.trajectory.x).max()))
    if not found > ERRORS_APART * claim:
        return None
    return Finding(
        "unverified",
        f"The flow amplifies errors: a run with a tolerance {LOOSER:g} times as large differs by "
        f"{found:.1e} of the state, where {claim:.2g} is claimed.",
    )


CHECKS = (
    Check(
        "amplified_error",
        ANY_PROBLEM,
        check_amplified_error,
        ("unverified",),
        criterion=f"difference of the runs > {ERRORS_APART:g} x {CLAIM:g} of the state, at tol = "
        f"{DEFAULT:g} and below; at larger ones in proportion",
    ),
)
