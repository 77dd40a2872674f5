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
from nsbench.diagnostics.contacts import (
    degenerate_normal,
    infeasible_constraints,
    infeasible_links,
    passed_through,
    soft_springs,
)
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
    Check(
        "hidden_error",
        ANY_PROBLEM,
        rounding.check_hidden_error,
        UNVERIFIED,
        even_if_exact=True,
        criterion="tolerance of the integrator over the motion > Resolution.max_tolerance",
    ),
    Check(
        "coincident_centres",
        Complementarity,
        degenerate_normal.check_coincident_centres,
        DEGENERATE,
        even_if_exact=True,
        criterion="distance of two centres = 0, and the start is kept as it is",
    ),
    Check(
        "infeasible_constraints",
        Complementarity,
        infeasible_constraints.check_infeasible_constraints,
        ("infeasible", "unverified"),
        criterion="infeasible: no point satisfies the rows, a chain of links is shorter than the "
        f"distance of its anchors by {infeasible_links.MISSED:g} of its length, or the linear "
        f"program leaves > {infeasible_constraints.CURVATURE:g} of the violation; unverified: the "
        "nearest state of the linearised constraints is farther than "
        f"{infeasible_constraints.FAR_FEASIBLE:g} times the sum of violations",
    ),
    Check(
        "passed_through",
        Complementarity,
        passed_through.check_passed_through,
        UNVERIFIED,
        even_if_exact=True,
        criterion="order of two particles on a line at a sample is not that of the start",
    ),
    Check(
        "vanishing_gradient",
        Complementarity,
        degenerate_normal.check_vanishing_gradient,
        DEGENERATE,
        even_if_exact=True,
        criterion="gradient of a constraint that pushes <= "
        f"{degenerate_normal.VANISHING_GRADIENT:g} of its largest along the run",
    ),
    Check(
        "soft_springs",
        Complementarity,
        soft_springs.check_soft_springs,
        UNVERIFIED,
        even_if_exact=True,
        criterion="largest violation of a run whose constraints are springs > "
        f"{soft_springs.SOFT:g} of own length, or > 0 and 1 / k > {soft_springs.SLOW:g} own time",
    ),
    Check(
        "deep_overlap",
        Complementarity,
        passed_through.check_deep_overlap,
        UNVERIFIED,
        even_if_exact=True,
        criterion=f"overlap of hard particles at a sample > {passed_through.DEEP:g} of the "
        "distance that they keep, and more than at the start",
    ),
    Check(
        "flat_switch",
        Filippov,
        flat_switch.check_flat_switch,
        UNVERIFIED,
        even_if_exact=True,
        criterion=f"slope of the switch changes by > {flat_switch.SLOPE_CHANGE:g} of itself "
        "within width / slope, or vanishes",
    ),
    Check(
        "start_in_layer",
        Filippov,
        repulsive_surface.check_start_in_layer,
        UNVERIFIED,
        even_if_exact=True,
        criterion="switch at the start < width of the layer, and both rates lead outward",
    ),
    Check(
        "never_leaves_layer",
        Filippov,
        flat_switch.check_never_leaves_layer,
        UNVERIFIED,
        even_if_exact=True,
        criterion="largest switch of the run, and its range, < width of the layer",
    ),
    Check(
        "late_exit_from_layer",
        Filippov,
        late_exit.check_late_exit_from_layer,
        UNVERIFIED,
        even_if_exact=True,
        criterion="inward rate < sqrt(width x slope of the turning rate) / "
        f"{late_exit.LAYER_LAG:g}, and < {late_exit.FAINT_RETURN:g} of the largest before",
    ),
    Check(
        "dependent_surfaces",
        Filippov,
        dependent_surfaces.check_dependent_surfaces,
        UNVERIFIED,
        even_if_exact=True,
        criterion="distance of the velocity to Filippov's set x time of the run > "
        f"{dependent_surfaces.LAYERS_OFF:g} widths of the layer, at two known states in a row",
    ),
    Check(
        "corner_velocity",
        Filippov,
        corner_velocity.check_corner_velocity,
        UNVERIFIED,
        even_if_exact=True,
        criterion=f"within {corner_velocity.NEAR_IN_STEPS:g} steps of two surfaces or more at "
        f"both ends of an interval; modes off an affine fit by > {corner_velocity.NOT_AFFINE:g} "
        "of the largest",
    ),
    Check(
        "drift_pole",
        WITHOUT_JUMPS,
        drift_poles.check_drift_pole,
        ("diverged", "unverified"),
        criterion=f"drift x distance to a zero of a denominator stays > {drift_poles.STAYS:g} of "
        f"itself where the distance falls by {drift_poles.DISTANCE_RATIO:g}; diverged: the "
        f"denominator is < {drift_poles.IN_TIME:g} of its largest at other states too",
    ),
    Check(
        "step_instability",
        Complementarity,
        step_instability.check_step_instability,
        ("diverged", "unverified"),
        even_if_exact=True,
        criterion=f"step x rate of decay > {step_instability.STABILITY_LIMIT:g}; diverged: the "
        f"state grew to > {step_instability.GROWTH:g} times its size at the start and at half of "
        "the samples",
    ),
    Check(
        "rounding",
        ANY_PROBLEM,
        rounding.check_rounding,
        UNVERIFIED,
        even_if_exact=True,
        criterion=f"steps x rounding of one > {rounding.LARGEST_SHARE:g} of the motion; the "
        f"rounding of one is {0.5 * rounding.EPS:.1e} of the state, "
        f"{rounding.IMPLICIT_ROUNDING:.1e} of implicit steps",
    ),
    Check(
        "nonunique_start",
        Filippov,
        nonunique_motion.check_nonunique_start,
        DEGENERATE,
        criterion="rates of two sectors or more lead into them, by > "
        f"{repulsive_surface.CLEAR_RATE:g} of the largest rate",
    ),
    Check(
        "repulsive_sliding",
        Filippov,
        repulsive_surface.check_repulsive_sliding,
        DEGENERATE,
        criterion=f"switch <= {repulsive_surface.ON_SURFACE:g} of its size at two known states in "
        f"a row, and outward rates > {repulsive_surface.CLEAR_RATE:g} of the largest (at rest: <= "
        f"{repulsive_surface.AT_REST:g})",
    ),
    Check(
        "two_fold",
        Filippov,
        nonunique_motion.check_two_fold,
        DEGENERATE,
        criterion=f"the rates of both sides turn within {nonunique_motion.AT_ONE_TIME:g} of an "
        f"interval, each by > {repulsive_surface.CLEAR_RATE:g} of the largest",
    ),
    Check(
        "late_exit",
        Filippov,
        late_exit.check_late_exit,
        UNVERIFIED,
        criterion="inward rate < step x slope of the turning rate, and < "
        f"{late_exit.FAINT_RETURN:g} of the largest before",
    ),
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
