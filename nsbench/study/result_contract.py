"""What a solver returned, held against the contract of a run: its word is not enough."""

from __future__ import annotations

import contextlib
import numbers

import numpy as np

from nsbench.case import Case
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.dynamics.contacts.tolerances import violates
from nsbench.problem import Complementarity
from nsbench.solvers.common.initial_state import initial_state
from nsbench.trajectory import LAM_TIMES, Status, Trajectory

ROUNDED = 1e-12  # of the start's size: what linear combinations of runs may leave of it
# of the step asked for: steps that divide the spacing of samples evenly are at least half as long
SHORTEST = 0.49
NEAREST = (
    10.0  # times the way to the start that is projected: one of the points that may be the nearest
)
COUNTS = 200  # entries of stats
SLACK = 1e-9  # relative, of steps: what dividing and adding them up rounds


def contract_violation(case: Case, traj, accuracy: str = "", asked: float = np.nan) -> str:
    """What is wrong with what a solver returned, as a sentence; "" if it keeps the contract.

    case: with the start that the run was given; accuracy, asked: what the solver was asked for ("":
    not looked at).
    """
    if not isinstance(traj, Trajectory) or not isinstance(traj.status, Status):
        what = (
            type(traj).__name__
            if not isinstance(traj, Trajectory)
            else f"a status of type {type(traj.status).__name__}"
        )
        return f"The solver returned {what}; a Trajectory with a Status is needed."
    for name, kind in (("contacts", tuple), ("stats", dict)):
        found = getattr(traj, name)
        if not isinstance(found, kind):
            return (
                f"The solver returned {name} of type {type(found).__name__}; a {kind.__name__} "
                f"is needed."
            )
    if traj.lam_time not in LAM_TIMES:
        return (
            f"The solver returned lam_time = {traj.lam_time!r:.40}; one of "
            f"{', '.join(LAM_TIMES)} is needed."
        )
    if len(traj.stats) > COUNTS:
        return (
            f"The solver returned stats with {len(traj.stats)} entries; at most {COUNTS} "
            f"become columns."
        )
    if not traj.status.ok:
        return ""
    if not np.array_equal(traj.t, case.t):
        return (
            f"The solver says ok, but its {np.size(traj.t)} times are not those of the case, "
            f"{len(case.t)} up to "
            f"{case.t[-1]:g}."
        )
    return (
        _arrays(case, traj)
        or _start(case, traj.x[0])
        or (_steps(case, traj.stats, asked) if accuracy == "h" else "")
    )


def _arrays(case: Case, traj: Trajectory) -> str:
    shapes = [("x", (len(case.t), case.n)), ("impulse", (len(case.t), len(traj.contacts)))]
    if np.size(
        traj.reaction
    ):  # some have none: of a field with switches, of methods that tell none
        shapes.append(("reaction", (len(case.t), case.n)))
    for name, shape in shapes:
        a = np.asarray(getattr(traj, name))
        if a.shape != shape or a.dtype != np.float64:
            return (
                f"The solver says ok, but {name} is {a.dtype} of shape {a.shape}; float64 "
                f"{shape} is needed."
            )
        if not np.all(np.isfinite(a)):
            return f"The solver says ok, but {name} is not finite."
    return ""


def _start(case: Case, x: np.ndarray) -> str:
    """Is x (n,) the start of the case? Where that is to be projected, any feasible point is:
    several may be the nearest. Where it misses by no more than it may, any feasible point is that
    is about as far away as the one that it is projected to."""
    away = float(np.abs(x - case.x0).max(initial=0.0))
    rounded = ROUNDED * float(np.abs(case.x0).max(initial=0.0))
    if case.start != "keep" and isinstance(case.problem, Complementarity):
        scene = ConstraintSet(case.problem, case.n)
        t = float(case.t[0])
        far = violates(case, scene, t, case.x0)
        if far and case.start == "project":
            return (
                ""
                if not violates(case, scene, t, x)
                else (
                    f"The solver says ok, but its first state violates a constraint by "
                    f"{scene.max_violation(t, x):.3g}; the start is to be "
                    "projected."
                )
            )
        if away > rounded and not far and not violates(case, scene, t, x):
            with contextlib.suppress(ValueError):  # no start is near
                rounded += NEAREST * float(
                    np.abs(initial_state(case, scene) - case.x0).max(initial=0.0)
                )
    if away <= rounded:
        return ""
    i = int(np.argmax(np.abs(x - case.x0)))
    return (
        f"The solver says ok, but it begins with {x[i]:.6g} in coordinate {i}, where the start of "
        f"the case is "
        f"{case.x0[i]:.6g}."
    )


def _steps(case: Case, stats: dict, asked: float) -> str:
    """Can the steps that the solver says it took be those it was asked for? Orders are fitted on
    them."""
    h = stats.get("h", asked)
    steps = stats.get("steps")
    span = float(case.t[-1] - case.t[0])
    # some take no step over a sample, however long a one is asked for
    least = SHORTEST * min(asked, float(np.diff(case.t).max()))
    if not isinstance(h, numbers.Real) or not least < h <= asked * (1.0 + SLACK):
        return (
            f"The solver says ok, but its steps of {_told(h)} are none that h = {asked:.6g} "
            f"allows over a time of {span:g}: "
            "stats['h'] is the longest step it took."
        )
    if steps is not None and not (
        isinstance(steps, numbers.Real) and steps * min(h, span) >= span * (1.0 - SLACK)
    ):
        return (
            f"The solver says ok, but {_told(steps)} steps of {h:.6g} do not cover a time of "
            f"{span:g}: stats['steps'] "
            "counts all of them."
        )
    return ""


def _told(value) -> str:
    return f"{value:.6g}" if isinstance(value, numbers.Real) else repr(value)[:40]
