"""Checks of nosnoc: switch values and multipliers too small for its absolute tolerances.

The tolerance of IPOPT and that of complementarity are absolute, and complementarity is left at a
product that is not zero: weight x distance, or gap x multiplier. The checks take every step of the
run (`Trajectory.between` of this method): times t (K,), states X (K, n), and the integrals W (K, m)
of weights or multipliers.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from nsbench.diagnostics.base import Check, Finding
from nsbench.diagnostics.filippov.flat_switch import find_flat_switch
from nsbench.diagnostics.rounding import largest_speed
from nsbench.diagnostics.run_view import RunView
from nsbench.problem import Affine, Complementarity, Filippov
from nsbench.solvers.nosnoc.model import count, dense, gaps

if TYPE_CHECKING:
    from nsbench.solvers.nosnoc.method import Nosnoc

RESOLVED = 100.0  # tolerances by which a switch has to change at least
LEAK = 1000.0  # tolerances by which the state may be pushed where nothing touches
OFF_SURFACE = 10.0  # tolerances from a surface or a contact: less may be on it
PRODUCT = 100.0  # tolerances: a larger product with the distance is no remainder of complementarity
SUNK = 1e-3  # depth below a constraint at which the push was too weak to hold


def checks_of(method: Nosnoc) -> tuple[Check, ...]:
    """Return the checks of a run of `method`, a Nosnoc with its tolerances; all precede others."""
    unverified = ("unverified",)
    return (
        Check(
            "nosnoc_step_tolerance",
            (Complementarity, Filippov),
            partial(check_step_tolerance, method),
            unverified,
            even_if_exact=True,
            criterion=f"steps x tolerance of IPOPT > {LEAK:g} comp_tol x motion",
        ),
        Check(
            "nosnoc_weak_push",
            Complementarity,
            partial(check_weak_push, method),
            ("infeasible",),
            even_if_exact=True,
            criterion=f"violation > {SUNK:g} of the motion, at most of 1",
        ),
        Check(
            "nosnoc_leaking_push",
            Complementarity,
            partial(check_leaking_push, method),
            unverified,
            even_if_exact=True,
            criterion=f"displacement by it > {LEAK:g} comp_tol x motion, at most x 1",
        ),
        Check(
            "nosnoc_unresolved_switch",
            Filippov,
            partial(check_unresolved_switch, method),
            unverified,
            even_if_exact=True,
            criterion=f"change of the switch <= {RESOLVED:g} comp_tol, or it is flat within "
            "comp_tol, or the state is kept sqrt(2 comp_tol x change) off a surface, or fields "
            f"beyond one push it by > {LEAK:g} comp_tol x motion",
        ),
    )


def _displacement(problem, t, X) -> float:
    """Return how far the run moves, or would in its time at the speed of the start."""
    duration = float(t[-1] - t[0])
    return max(float(np.abs(X - X[0]).max()), duration * largest_speed(problem, float(t[0]), X[0]))


def check_step_tolerance(method: Nosnoc, run: RunView) -> Finding | None:
    """Find motions so small that what IPOPT leaves in each step, which is absolute, is large."""
    t, X, _ = run.trajectory.between
    left = method.step_tolerance * (len(X) - 1)
    displacement = _displacement(run.case.problem, t, X)
    if left <= LEAK * method.comp_tol * displacement:
        return None
    return Finding(
        "unverified",
        f"The steps are solved to {method.step_tolerance:.2g}, in all to {left:.2g}, which is much "
        f"for a motion by {displacement:.2g}: take units in which that is about 1.",
    )


def check_unresolved_switch(method: Nosnoc, run: RunView) -> Finding | None:
    """Find switches that complementarity does not resolve to its tolerance.

    A switch must change by more than the tolerance over all that the run moves, and must not be
    flat in it; the state must not be kept off a surface, nor be pushed by fields beyond one.
    """
    tol = method.comp_tol
    t, X, W = run.trajectory.between
    problem = run.case.problem
    motion = run.vector_field
    duration = float(t[-1] - t[0])
    # a state at rest on a surface is pushed there: its own displacement says nothing
    displacement = max(
        _displacement(problem, t, X),
        duration * max(largest_speed(problem, float(at), x) for at, x in zip(t, X, strict=True)),
    )
    change = np.max(
        [
            np.abs(motion.gradients(float(at), x, np.arange(motion.d))).sum(axis=1) * displacement
            + np.abs(motion.along(float(at), x, 1.0, np.zeros(run.case.n))) * duration
            for at, x in zip(t, X, strict=True)
        ],
        axis=0,
    )
    row = int(np.argmin(change))
    if not change[row] > RESOLVED * tol:
        return Finding(
            "unverified",
            f"Switch {row} changes by {change[row]:.2g} in the run, which the tolerance of "
            f"complementarity, {tol:.2g}, cannot tell from zero: scale it, or lower comp_tol.",
        )
    c = np.array([motion.switch(float(at), x) for at, x in zip(t, X, strict=True)])
    where = (
        find_flat_switch(motion, tol, t, X)
        or _kept_off_surface(t, c, tol, change)
        or _pushed_from_beyond(problem, tol, t, c, X, W)
    )
    if not where:
        return None
    return Finding("unverified", f"{where}: no error of that size is claimed there.")


def _kept_off_surface(t, c, tol, change) -> str:
    """Say where the remainder of complementarity keeps a state off a surface; "" if nowhere.

    The remainder is weight x distance = tol. Where one field ends on the surface, it pushes the
    state away by sqrt(2 tol x speed of the other), which is no small length.
    """
    near = (np.abs(c) > OFF_SURFACE * tol) & (np.abs(c) < np.sqrt(2.0 * tol * change))
    last = (np.arange(1, len(c)) == len(c) - 1)[:, None]
    found = np.argwhere(near[1:] & (near[:-1] | last))
    if not len(found):
        return ""
    at, row = found[0]
    return (
        f"At t = {t[at + 1]:.6g} the state is {abs(c[at + 1, row]):.2g} from surface {row}, "
        f"as what is left of complementarity ({tol:.2g}) may keep it"
    )


def _pushed_from_beyond(problem, tol, t, c, X, W) -> str:
    """Say how far fields beyond surfaces that are not reached have pushed the state; "" if little.

    Their weight is tol over the distance, not zero: while a state passes near, or where a switch is
    flat, that adds up.
    """
    h = np.diff(t)[:, None]
    one_side = np.sign(c[1:]) * np.sign(c[:-1]) > 0.0
    distance = np.maximum(np.abs(c[1:]), np.abs(c[:-1]))
    theta = np.clip(np.diff(W, axis=0) / h, 0.0, 1.0)
    beyond = np.where(c[1:] > 0.0, 1.0 - theta, theta)  # weight of the field of the other side
    acts = one_side & (distance > OFF_SURFACE * tol) & (beyond * distance < PRODUCT * tol)
    pushed = (
        2.0
        * largest_speed(problem, float(t[0]), X[0])
        * float((np.where(acts, beyond, 0.0) * h).sum())
    )
    if pushed <= LEAK * tol * min(1.0, _displacement(problem, t, X)):
        return ""
    return (
        f"Fields beyond surfaces that are not reached have pushed by {pushed:.2g} in all, "
        "their weights not being zero"
    )


def check_weak_push(method: Nosnoc, run: RunView) -> Finding | None:
    """Find constraints that the push, the largest multiplier of the model, could not hold."""
    t, X, _ = run.trajectory.between
    worst = _gaps(run, t, X).min()
    if worst >= -SUNK * min(1.0, _displacement(run.case.problem, t, X)):
        return None
    return Finding(
        "infeasible",
        f"A constraint is violated by {-worst:.3g}: a multiplier is above the push; raise it.",
    )


def check_leaking_push(method: Nosnoc, run: RunView) -> Finding | None:
    """Find constraints that push the state although they do not touch.

    gap x multiplier is comp_tol x push, not zero: while a gap opens slowly, or many are open for
    long, that adds up.
    """
    t, X, W = run.trajectory.between
    floor = method.comp_tol * method.push
    gap = _gaps(run, t, X)
    # |grad g| of each constraint
    slope = np.concatenate(
        [
            np.linalg.norm(dense(c), axis=1)
            if isinstance(c, Affine)
            else np.full(count(c, run.case.n), 2.0**0.5)
            for c in run.case.problem.constraints
        ]
    )
    largest = np.maximum(gap[1:], gap[:-1])
    gained = np.diff(W, axis=0)
    small = gained * largest < PRODUCT * floor * np.diff(t)[:, None]
    apart = (largest > OFF_SURFACE * floor) & small
    pushed = float((np.where(apart, gained, 0.0) * slope).sum())
    if pushed <= LEAK * method.comp_tol * min(1.0, _displacement(run.case.problem, t, X)):
        return None
    return Finding(
        "unverified",
        f"Constraints that do not touch have pushed by {pushed:.2g} in all, for gap x multiplier "
        f"is {floor:.2g}, not zero: no smaller error is claimed; lower comp_tol.",
    )


def _gaps(run: RunView, t, X) -> np.ndarray:
    """(K, m) gaps of all constraints at every step."""
    problem = run.case.problem
    return np.array(
        [
            [float(g) for _, g in gaps(problem, x, float(at), np, run.case.n)]
            for at, x in zip(t, X, strict=True)
        ]
    )
