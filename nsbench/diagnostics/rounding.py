"""Checks: accumulated rounding, and relative tolerances that are large beside the motion.

A step rounds each coordinate to half a spacing of numbers of its size, and the tolerance of a step
control is relative to coordinates too. Far from the origin both are large beside the motion.
"""

from __future__ import annotations

import numpy as np

from nsbench.case import Case
from nsbench.case.scale import size_text
from nsbench.compilation.factories import as_numpy
from nsbench.diagnostics.base import Finding
from nsbench.diagnostics.run_view import RunView
from nsbench.problem import LCS, Complementarity, Filippov, Hybrid, Problem

EPS = float(np.finfo(float).eps)
LARGEST_SHARE = 1e-2  # of the motion that the rounding of all steps may add up to
# relative rounding of an implicit step on a surface: nsbench.solvers.euler.kernels.loop stops its
# iteration there
IMPLICIT_ROUNDING = 4 * EPS
FAR_FROM_ORIGIN = 1e3  # |x| / |x - x0| above which a relative tolerance does not measure the motion
HALF = 0.5  # of a run: what grows later has grown from errors made before


def check_rounding(run: RunView) -> Finding | None:
    """Find runs of so many steps that their rounding may add up to a hundredth of the motion.

    Every step rounds the state by half a spacing of numbers; an implicit step on a surface leaves
    as much as its iteration leaves of the equation. The motion is that of the samples, or what the
    drift would do in the time of the run, if that is more: a state may be at rest on a constraint.
    """
    traj = run.trajectory
    implicit = isinstance(run.case.problem, Filippov) and run.resolution.rule == "implicit"
    each = IMPLICIT_ROUNDING if implicit else 0.5 * EPS
    total = float(traj.stats.get("steps", 0)) * each * float(np.abs(traj.x).max(initial=0.0))
    if not total > LARGEST_SHARE * float(np.abs(traj.x - traj.x[0]).max(initial=0.0)):
        return None
    speed = max(
        largest_speed(run.case.problem, float(t), x) for t, x in zip(traj.t, traj.x, strict=True)
    )
    if not 0.0 < LARGEST_SHARE * speed * float(traj.t[-1] - traj.t[0]) < total:
        return None
    size = np.abs(traj.x).max()
    return Finding(
        "unverified",
        f"The roundings of {int(traj.stats['steps'])} steps of a state of {size_text(size)} may "
        "add up to "
        f"{size_text(total, 2)}, which is more than a hundredth of the motion: take longer steps, "
        "or a "
        "frame in which the state is not so large.",
    )


def check_hidden_error(run: RunView) -> Finding | None:
    """Find runs whose step control may hide the error that the method claims.

    The tolerance of the integrator, relative to the motion, is compared with the largest one that
    leaves the claimed error visible: Resolution.tolerance and Resolution.max_tolerance.
    """
    r = run.resolution
    if not r.tolerance:
        return None
    tolerance = r.tolerance * distance_over_motion(run.case, run.trajectory.x)
    if not tolerance > r.max_tolerance:
        return None
    return Finding(
        "unverified",
        f"The error of the penalty, about {r.claimed_error:.1e}, may be hidden by the "
        f"integrator's, up to 200 times its tolerance of {tolerance:.1e} of the motion: lower rtol "
        "and atol.",
    )


def largest_speed(problem: Problem, t: float, x: np.ndarray) -> float:
    """Return the largest speed of a coordinate at x (n,) by the drift, by that of any mode, or by a
    field off all surfaces.

    Infinite at a pole.
    """
    if isinstance(problem, LCS):
        speeds = [problem.A @ x + (as_numpy(problem.u)(t) if problem.u else 0.0)]
    elif isinstance(problem, Complementarity):
        speeds = [as_numpy(problem.drift)(t, x.copy())]
    elif isinstance(problem, Hybrid):
        speeds = [as_numpy(drift)(t, x.copy()) for drift in problem.modes.values()]
    else:
        field = as_numpy(problem.field)
        d = len(np.atleast_1d(as_numpy(problem.switch)(t, x)))
        speeds = [field(t, x.copy(), np.full(d, s)) for s in (1.0, -1.0)]
    return float(np.abs(speeds).max(initial=0.0))


def distance_over_motion(case: Case, X: np.ndarray) -> float:
    """Return how many lengths of its motion a run of samples X (K, n) is from the origin.

    The motion counts as at least 1; of its first half and the whole of the run the larger ratio
    counts, and 1.0 is returned if it is below FAR_FROM_ORIGIN. Coordinates at rest are as accurate
    as at the start and do not count.
    """
    moved = np.abs(X - X[0])
    size = np.abs(X)[:, np.any(X != X[0], axis=0)]
    half = HALF * (case.t[-1] - case.t[0])
    early = case.t - case.t[0] <= half
    if early.sum() > 1:
        displacement = moved[early].max()
    else:  # no sample lies there: the displacement at the speed of the start
        displacement = min(
            moved.max(), half * largest_speed(case.problem, float(case.t[0]), case.x0)
        )
    ratio = max(
        size[k].max(initial=1.0) / max(1.0, float(w))
        for k, w in ((early, displacement), (slice(None), moved.max()))
    )
    return float(ratio) if ratio > FAR_FROM_ORIGIN else 1.0
