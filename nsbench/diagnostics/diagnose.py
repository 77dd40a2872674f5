"""What a run that says ok may not know: that its constraints leave no point or no direction to push
in, that it is rounding.

A projection moves somewhere even where there is nowhere to go: contradicting walls are met
half-way, and a constraint whose gradient vanishes throws the state far away. Whatever the method,
such a run is no solution, and is not called ok.
Nothing is looked at where it cannot happen: a start that was found feasible proves that constraints
at rest leave a point.
Steps round the state: where they are so many that their roundings can add up to a part of the
motion, nothing is known.
"""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np

from nsbench.case import Case
from nsbench.compilation.factories import as_numpy
from nsbench.diagnostics.contacts.infeasible_constraints import check_infeasible_constraints
from nsbench.diagnostics.contacts.passed_through import check_passed_through
from nsbench.diagnostics.drift_poles import check_drift_pole
from nsbench.diagnostics.filippov.late_exit import check_late_exit
from nsbench.diagnostics.filippov.nonunique_motion import check_nonunique_start, check_two_fold
from nsbench.diagnostics.filippov.repulsive_surface import check_repulsive_sliding
from nsbench.diagnostics.run_view import fuller
from nsbench.dynamics.contacts.constraint_set import ANCHOR, PAIR
from nsbench.dynamics.contacts.tolerances import scene_of
from nsbench.problem import LCS, Complementarity, Distance, Filippov, Smooth
from nsbench.trajectory import Status, Trajectory

EPS = float(np.finfo(float).eps)
GREW = 10.0  # over the start's size, and over that of half of the samples
ROUNDED = 1e-2  # part of the motion that roundings of all steps may add up to
SLIDES = 4 * EPS  # of the state, as in nsbench.solvers.euler.kernels.loop
FLAT = (
    1e-6  # gradient over its largest along the run: below it a constraint does not push but throws
)


def diagnose(case: Case, traj: Trajectory) -> Trajectory:
    """The run with the status infeasible, degenerate or unverified where it says ok and cannot be;
    itself everywhere else."""
    p = case.problem
    if not traj.status.ok or not len(traj.t):
        return traj
    with np.errstate(all="ignore"):
        known = case.exact is not None  # then the error is seen, and the solution is there
        status = (
            (None if known else check_drift_pole(case, traj))
            or check_step_instability(case, traj)
            or check_rounding(case, traj)
        )
        if isinstance(p, Filippov) and not known:
            seen = fuller(traj)
            status = (
                status
                or check_nonunique_start(case)
                or check_repulsive_sliding(case, seen)
                or check_two_fold(case, seen)
                or _overslid(case, seen)
            )
        if isinstance(p, Complementarity) and p.constraints:
            status = (
                check_coincident_centres(case)
                or check_infeasible_constraints(case, traj)
                or check_passed_through(case, traj)
                or check_vanishing_gradient(case, traj)
                or status
            )
    return traj if status is None else replace(traj, status=status)


def _overslid(case: Case, traj: Trajectory) -> Status | None:
    """Explicit steps over a surface that keep the state beside it when the slide has ended."""
    where = (
        check_late_exit(case, traj, step=float(traj.stats.get("h") or 0.0))
        if traj.lam_time == "start"
        else ""
    )
    return Status("unverified", f"{where}: no error of size h is claimed there.") if where else None


def check_step_instability(case: Case, traj: Trajectory) -> Status | None:
    """A state that grew although the drift pulls back: steps h of it lead over to the other side,
    further away each time.

    An explicit step multiplies what decays with rate r by 1 - r h, which grows beyond r h = 2
    (Hairer & Wanner, Solving ODEs II, chapter IV.2). Looked at where the samples are largest:
    |drift| h of more than twice the state, and against it.
    """
    h = float(traj.stats.get("h", 0.0) or 0.0)
    p = case.problem
    sizes = np.abs(traj.x).max(axis=1, initial=0.0)
    k = int(np.argmax(sizes))
    if not (
        isinstance(p, Complementarity)
        and h > 0.0
        and sizes[k] > GREW * max(sizes[0], float(np.median(sizes)))
    ):
        return None
    i = int(np.argmax(np.abs(traj.x[k])))
    f = as_numpy(p.drift)(traj.t[k], traj.x[k].copy())
    if not -f[i] * h * np.sign(traj.x[k, i]) > 2.0 * sizes[k]:
        return None
    return Status(
        "diverged",
        f"The state grew to {sizes[k]:.3g} at t = {traj.t[k]:.6g} although the drift pulls it "
        f"back: steps "
        f"of {h:.3g} overshoot; take them shorter than {2.0 * sizes[k] / abs(f[i]):.3g}.",
    )


def check_rounding(case: Case, traj: Trajectory) -> Status | None:
    """Steps so many that their roundings, each half a spacing of the state, may add up to a part of
    the motion; those of implicit steps on a surface too, each as much as they leave of its
    equation.

    The motion is that of the samples, or what the drift would make of the time, if that is more: a
    state may be held.
    """
    each = SLIDES if isinstance(case.problem, Filippov) and traj.lam_time == "end" else 0.5 * EPS
    lost = float(traj.stats.get("steps", 0)) * each * float(np.abs(traj.x).max(initial=0.0))
    if not lost > ROUNDED * float(np.abs(traj.x - traj.x[0]).max(initial=0.0)):
        return None
    speed = max(
        largest_speed(case.problem, float(t), x) for t, x in zip(traj.t, traj.x, strict=True)
    )
    if not 0.0 < ROUNDED * speed * float(traj.t[-1] - traj.t[0]) < lost:
        return None
    size = np.abs(traj.x).max()
    return Status(
        "unverified",
        f"The roundings of {int(traj.stats['steps'])} steps of a state of {size:.3g} may add up to "
        f"{lost:.2g}, which is more than a hundredth of the motion: take longer steps, or a "
        "frame in which the state is not so large.",
    )


def largest_speed(problem, t: float, x: np.ndarray) -> float:
    """Largest speed that the drift, or a field beside all surfaces, gives to a coordinate; infinite
    at a pole."""
    if isinstance(problem, LCS):
        speeds = [problem.A @ x + (as_numpy(problem.u)(t) if problem.u else 0.0)]
    elif isinstance(problem, Complementarity):
        speeds = [as_numpy(problem.drift)(t, x.copy())]
    else:
        field = as_numpy(problem.field)
        d = len(np.atleast_1d(as_numpy(problem.switch)(t, x)))
        speeds = [field(t, x.copy(), np.full(d, s)) for s in (1.0, -1.0)]
    return float(np.abs(speeds).max(initial=0.0))


@functools.lru_cache(maxsize=512)
def check_coincident_centres(case: Case) -> Status | None:
    """Coincident centres at a start that is kept: which way they part is no property of the
    case."""
    if case.start != "keep" or not any(isinstance(c, Distance) for c in case.problem.constraints):
        return None
    t = float(case.t[0])
    scene = scene_of(case)
    near = scene.near(case.x0, 0.0, t)
    g = scene.gaps(t, case.x0, near)
    tie = np.flatnonzero(np.isin(near.kind, (PAIR, ANCHOR)) & (near.sign > 0) & (g == -near.d))
    if not tie.size:
        return None
    return Status(
        "degenerate",
        f"The start has coincident centres, {near.ids[int(tie[0])]}: their contact has no normal, "
        f"and "
        "each method parts them in a direction of its own.",
    )


def check_vanishing_gradient(case: Case, traj: Trajectory) -> Status | None:
    """A smooth constraint that pushes where its gradient vanishes."""
    if not any(isinstance(c, Smooth) for c in case.problem.constraints):
        return None
    scene = scene_of(case)
    acts = np.abs(np.diff(traj.impulse, axis=0)) > 0.0
    families = [k for k, c in enumerate(scene.families) if isinstance(c, Smooth)]
    for s, k in enumerate(families):
        mine = [(c, ident[1]) for c, ident in enumerate(traj.contacts) if ident[0] == k]
        if not mine:
            continue
        grads = [
            np.asarray(scene.smooth(s).gradient(t, x)) for t, x in zip(traj.t, traj.x, strict=True)
        ]
        size = np.sqrt((np.array(grads) ** 2).sum(-1))  # (samples, rows)
        for c, row in mine:
            pushing = np.flatnonzero(
                acts[:, c]
                & (np.minimum(size[:-1, row], size[1:, row]) <= FLAT * np.nanmax(size[:, row]))
            )
            if pushing.size:
                return Status(
                    "degenerate",
                    f"Constraint {(k, row)} pushes at t = {traj.t[pushing[0] + 1]:.6g} where its "
                    "gradient vanishes: there is no direction to push in.",
                )
    return None
