"""Check a solver's whole answer against the contract: returned values, then start and steps.

The values are checked by solvers.common.returned_value, which every run passes.

A status "ok" is the solver's claim. Here shapes, types, times, start and steps are checked; what
the numbers are worth is measured (nsbench.measure) and diagnosed (nsbench.diagnostics) afterwards.
"""

from __future__ import annotations

import contextlib
import numbers
from typing import Any

import numpy as np

from nsbench.case import Case
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.dynamics.contacts.tolerances import violates
from nsbench.problem import Complementarity
from nsbench.solvers.common.initial_state import initial_state
from nsbench.solvers.common.returned_value import returned_violation

# of the start's size: rounding of the start by linear combinations of runs
START_ROUNDING = 1e-12
# of the requested step: steps that divide the spacing of samples evenly are at least half as long
SHORTEST_STEP = 0.49
# of the distance to the projected start, within which another nearest point may lie
NEAREST_POINTS = 10.0
STEP_ROUNDING = 1e-9  # relative: steps are divided and added up


def contract_violation(case: Case, traj: Any, accuracy: str = "", asked: float = np.nan) -> str:
    """Return how a solver's answer breaks the contract, as a sentence; "" if it keeps it.

    case: with the start that the run was given; accuracy, asked: name and value of the requested
    accuracy (with the name "" steps are not checked).
    """
    wrong = returned_violation(case, traj)
    if wrong or not traj.status.ok:
        return wrong
    return _start(case, traj.x[0]) or (_steps(case, traj.stats, asked) if accuracy == "h" else "")


def _start(case: Case, x: np.ndarray) -> str:
    """Check that x (n,) is the start of the case.

    Where an infeasible start is projected, any feasible point is accepted: several may be the
    nearest. Where the start violates constraints within their tolerances, any feasible point is
    accepted that is about as far away as the projected start.
    """
    distance = float(np.abs(x - case.x0).max(initial=0.0))
    rounded = START_ROUNDING * float(np.abs(case.x0).max(initial=0.0))
    if case.start != "keep" and isinstance(case.problem, Complementarity):
        scene = ConstraintSet(case.problem, case.n)
        t = float(case.t[0])
        infeasible = violates(case, scene, t, case.x0)
        if infeasible and case.start == "project":
            return (
                ""
                if not violates(case, scene, t, x)
                else (
                    f"The solver says ok, but its first state violates a constraint by "
                    f"{scene.max_violation(t, x):.3g}; the start is to be "
                    "projected."
                )
            )
        if distance > rounded and not infeasible and not violates(case, scene, t, x):
            with contextlib.suppress(ValueError):  # no start is near
                rounded += NEAREST_POINTS * float(
                    np.abs(initial_state(case, scene) - case.x0).max(initial=0.0)
                )
    if distance <= rounded:
        return ""
    i = int(np.argmax(np.abs(x - case.x0)))
    return (
        f"The solver says ok, but it begins with {x[i]:.6g} in coordinate {i}, where the start of "
        f"the case is "
        f"{case.x0[i]:.6g}."
    )


def _steps(case: Case, stats: dict, asked: float) -> str:
    """Check that the reported steps can be those that were requested: orders are fitted on
    them."""
    h = stats.get("h", asked)
    steps = stats.get("steps")
    span = float(case.t[-1] - case.t[0])
    # some methods never step over a sample, however long the requested step
    shortest = SHORTEST_STEP * min(asked, float(np.diff(case.t).max()))
    if not isinstance(h, numbers.Real) or not shortest < float(h) <= asked * (1.0 + STEP_ROUNDING):
        return (
            f"The solver says ok, but its steps of {_format(h)} are none that h = {asked:.6g} "
            f"allows over a time of {span:g}: "
            "stats['h'] is the longest step it took."
        )
    if steps is not None and not (
        isinstance(steps, numbers.Real)
        and float(steps) * min(float(h), span) >= span * (1.0 - STEP_ROUNDING)
    ):
        return (
            f"The solver says ok, but {_format(steps)} steps of {h:.6g} do not cover a time of "
            f"{span:g}: stats['steps'] "
            "counts all of them."
        )
    return ""


def _format(value) -> str:
    return f"{value:.6g}" if isinstance(value, numbers.Real) else repr(value)[:40]
