"""One run of a method that must end well, or the study stops."""

from __future__ import annotations

from nsbench.case import Case
from nsbench.solvers import get, solve
from nsbench.trajectory import Trajectory

WELL = ("ok",)
USABLE = ("ok", "unverified", "degenerate")  # of runs that reached the end


def finish(
    case: Case, method: str, accuracy: float | None = None, allowed: tuple[str, ...] = WELL
) -> Trajectory:
    """Run a method with the value of its accuracy parameter, None: its default.

    Raises ArithmeticError, with the status, where the run ends with one that is not allowed.
    """
    options = {} if accuracy is None else {get(method).accuracy: accuracy}
    traj = solve(case, method, **options)
    if traj.status.code not in allowed:
        raise ArithmeticError(f"{method} on {case.key} from t = {case.t[0]:g}: {traj.status}")
    return traj
