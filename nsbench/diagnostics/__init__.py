"""Checks of a finished run: reasons why it may be no solution, or less accurate than claimed.

A method reports what stopped it. What it cannot notice is checked afterwards, for every method
alike: a projection returns a point even where the constraints contradict each other, explicit steps
pass over a pole, a state stays on a surface that it may leave at any time. Each check is a function
of a `RunView`; CHECKS lists them in order of precedence, and `diagnose` applies them to a run that
ended well. It is called once, outside of what the clock measures.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nsbench.case import Case
from nsbench.diagnostics import drift_poles, rounding, step_instability
from nsbench.diagnostics.base import ANY_PROBLEM, WITHOUT_JUMPS, Check, Finding
from nsbench.diagnostics.contacts import degenerate_normal, infeasible_constraints, passed_through
from nsbench.diagnostics.filippov import (
    corner_velocity,
    dependent_surfaces,
    flat_switch,
    late_exit,
    nonunique_motion,
    repulsive_surface,
)
from nsbench.diagnostics.run_view import RunView
from nsbench.problem import Complementarity, Filippov
from nsbench.trajectory import Status, Trajectory

__all__ = ["CHECKS", "Check", "Finding", "RunView", "diagnose"]

UNVERIFIED = ("unverified",)
DEGENERATE = ("degenerate",)

# The first finding counts. A tolerance that hides the error, layers and corners come before the
# general checks: they say why the method cannot be right there, and not only that it may be wrong.
CHECKS = (
    Check("hidden_error", ANY_PROBLEM, rounding.check_hidden_error, UNVERIFIED, even_if_exact=True),
    Check(
        "coincident_centres",
        Complementarity,
        degenerate_normal.check_coincident_centres,
        DEGENERATE,
        even_if_exact=True,
    ),
    Check(
        "infeasible_constraints",
        Complementarity,
        infeasible_constraints.check_infeasible_constraints,
        ("infeasible", "unverified"),
    ),
    Check(
        "passed_through",
        Complementarity,
        passed_through.check_passed_through,
        UNVERIFIED,
        even_if_exact=True,
    ),
    Check(
        "vanishing_gradient",
        Complementarity,
        degenerate_normal.check_vanishing_gradient,
        DEGENERATE,
        even_if_exact=True,
    ),
    Check("flat_switch", Filippov, flat_switch.check_flat_switch, UNVERIFIED, even_if_exact=True),
    Check(
        "start_in_layer",
        Filippov,
        repulsive_surface.check_start_in_layer,
        UNVERIFIED,
        even_if_exact=True,
    ),
    Check(
        "never_leaves_layer",
        Filippov,
        flat_switch.check_never_leaves_layer,
        UNVERIFIED,
        even_if_exact=True,
    ),
    Check("late_exit_from_layer", Filippov, late_exit.check_late_exit_from_layer, UNVERIFIED, True),
    Check(
        "dependent_surfaces",
        Filippov,
        dependent_surfaces.check_dependent_surfaces,
        UNVERIFIED,
        even_if_exact=True,
    ),
    Check(
        "corner_velocity",
        Filippov,
        corner_velocity.check_corner_velocity,
        UNVERIFIED,
        even_if_exact=True,
    ),
    Check("drift_pole", WITHOUT_JUMPS, drift_poles.check_drift_pole, ("diverged", "unverified")),
    Check(
        "step_instability",
        Complementarity,
        step_instability.check_step_instability,
        ("diverged", "unverified"),
        even_if_exact=True,
    ),
    Check("rounding", ANY_PROBLEM, rounding.check_rounding, UNVERIFIED, even_if_exact=True),
    Check("nonunique_start", Filippov, nonunique_motion.check_nonunique_start, DEGENERATE),
    Check("repulsive_sliding", Filippov, repulsive_surface.check_repulsive_sliding, DEGENERATE),
    Check("two_fold", Filippov, nonunique_motion.check_two_fold, DEGENERATE),
    Check("late_exit", Filippov, late_exit.check_late_exit, UNVERIFIED),
)


def diagnose(case: Case, traj: Trajectory, extra: tuple[Check, ...] = ()) -> Trajectory:
    """Return the trajectory with the status of the first finding, and the name of its check.

    extra: checks of the method's own, which precede CHECKS. A run that is not ok, or has no
    samples, is returned as it is, and so is one without a finding.
    """
    if not traj.status.ok or not len(traj.t):
        return traj
    run = RunView(case, traj)
    with np.errstate(all="ignore"):
        for check in (*extra, *CHECKS):
            finding = check.find(run) if check.applies_to(run) else None
            if finding is not None:
                status = Status(finding.status, finding.message, check.name)
                return replace(traj, status=status)
    return traj
