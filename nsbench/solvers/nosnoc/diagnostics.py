"""What nosnoc's tolerances hide: each is absolute, and complementarity is left to a product that is
not zero.

The checks take the case with every step a sample, its states X (K, n) and the integrals W (K, m) of
multipliers or weights.
"""

from __future__ import annotations

import numpy as np

from nsbench.problem import Affine
from nsbench.solvers.nosnoc.model import count, dense, gaps
from nsbench.trajectory import Status

UNSEEN = 100.0  # tolerances by which a switch has to change to be seen
SOLVED = 1e-2  # of comp_tol: tolerance of IPOPT
LEAK = 1000.0  # tolerances by which the state may be pushed where nothing touches
BESIDE = 10.0  # the same of a state that is on a surface
SUNK = 1e-3  # depth below a constraint at which the push was too weak to hold


def _way(case, X) -> float:
    """How far the run moves, or would in its time at the pace of the start."""
    from nsbench.diagnostics.diagnose import largest_speed

    with np.errstate(all="ignore"):
        T = float(case.t[-1] - case.t[0])
        return max(
            float(np.abs(X - X[0]).max()), T * largest_speed(case.problem, float(case.t[0]), X[0])
        )


def coarse(case, method, X, W) -> Status:
    """Is what IPOPT leaves in each step, which is absolute, small beside the motion?"""
    left = SOLVED * method.comp_tol * (len(X) - 1)
    way = _way(case, X)
    if left <= LEAK * method.comp_tol * way:
        return Status()
    return Status(
        "unverified",
        f"The steps are solved to {SOLVED * method.comp_tol:.2g}, in all to {left:.2g}, which is "
        f"much "
        f"for a motion by {way:.2g}: take units in which that is about 1.",
    )


def unresolved(case, method, X, W) -> Status:
    """Can each switch change by more than the tolerance of complementarity, over all that the run
    moves?"""
    from nsbench.diagnostics.diagnose import largest_speed
    from nsbench.diagnostics.filippov.flat_switch import check_flat_switch
    from nsbench.dynamics.filippov.vector_field import FilippovVectorField

    tol = method.comp_tol
    motion = FilippovVectorField(case.problem, float(case.t[0]), X[0].copy())
    T = float(case.t[-1] - case.t[0])
    with np.errstate(all="ignore"):
        # what is held at rest on a surface is pushed there: its own way tells nothing
        way = max(
            _way(case, X),
            T
            * max(largest_speed(case.problem, float(t), x) for t, x in zip(case.t, X, strict=True)),
        )
        slope = np.max(
            [
                np.abs(motion.gradients(float(t), x, np.arange(motion.d))).sum(axis=1) * way
                + np.abs(motion.along(float(t), x, 1.0, np.zeros(case.n))) * T
                for t, x in zip(case.t, X, strict=True)
            ],
            axis=0,
        )
    row = int(np.argmin(slope))
    if slope[row] > UNSEEN * tol:
        c = np.array([motion.switch(float(t), x) for t, x in zip(case.t, X, strict=True)])
        flat = (
            check_flat_switch(case, tol, case.t, X)
            or _lingers(case, c, tol, slope)
            or _leans(case, method, c, X, W)
        )
        return (
            Status("unverified", f"{flat}: no error of that size is claimed there.")
            if flat
            else Status()
        )
    return Status(
        "unverified",
        f"Switch {row} changes by {slope[row]:.2g} in the run, which the tolerance of "
        f"complementarity, "
        f"{tol:.2g}, cannot tell from zero: scale it, or lower comp_tol.",
    )


def _lingers(case, c, tol, slope) -> str:
    """Where a state is kept off a surface by what is left of complementarity, weight x distance =
    tol: where one field ends on the surface, that pushes it away by sqrt(2 tol x pace of the
    other), no small length; "" if nowhere."""
    beside = (np.abs(c) > BESIDE * tol) & (np.abs(c) < np.sqrt(2.0 * tol * slope))
    found = np.argwhere(beside[1:] & (beside[:-1] | (np.arange(1, len(c)) == len(c) - 1)[:, None]))
    if not len(found):
        return ""
    at, row = found[0]
    return (
        f"At t = {case.t[at + 1]:.6g} the state is {abs(c[at + 1, row]):.2g} from surface {row}, "
        f"as what is left of "
        f"complementarity ({tol:.2g}) may keep it"
    )


def _leans(case, method, c, X, W) -> str:
    """Has the field beyond a surface that is not reached been mixed in? Its weight is tol over the
    distance, not zero: while a state passes near, or where a switch is flat, that adds up; "" if it
    has not."""
    from nsbench.diagnostics.diagnose import largest_speed

    tol = method.comp_tol
    T = np.diff(case.t)[:, None]
    beside = np.sign(c[1:]) * np.sign(c[:-1]) > 0.0
    near = np.maximum(np.abs(c[1:]), np.abs(c[:-1]))
    theta = np.clip(np.diff(W, axis=0) / T, 0.0, 1.0)
    strange = np.where(c[1:] > 0.0, 1.0 - theta, theta)
    mixed = beside & (near > BESIDE * tol) & (strange * near < 100.0 * tol)
    with np.errstate(all="ignore"):
        pushed = (
            2.0
            * largest_speed(case.problem, float(case.t[0]), X[0])
            * float((np.where(mixed, strange, 0.0) * T).sum())
        )
    if pushed <= LEAK * tol * min(1.0, _way(case, X)):
        return ""
    return (
        f"Fields beyond surfaces that are not reached have pushed by {pushed:.2g} in all, "
        f"their weights not being zero"
    )


def sunk(case, method, X, W) -> Status:
    """Did the push hold every constraint?"""
    worst = min(
        min(float(g) for _, g in gaps(case.problem, x, float(t), np, case.n))
        for t, x in zip(case.t, X, strict=True)
    )
    if worst >= -SUNK * min(1.0, _way(case, X)):
        return Status()
    return Status(
        "infeasible",
        f"A constraint is violated by {-worst:.3g}: a multiplier is above the push; raise it.",
    )


def leaks(case, method, X, W) -> Status:
    """Have constraints pushed where they do not touch? gap x multiplier is comp_tol x push, not
    zero: while a gap opens slowly, or many are open for long, that adds up."""
    floor = method.comp_tol * method.push
    depth = np.array(
        [
            [float(g) for _, g in gaps(case.problem, x, float(t), np, case.n)]
            for t, x in zip(case.t, X, strict=True)
        ]
    )
    steep = np.concatenate(
        [
            np.linalg.norm(dense(c), axis=1)
            if isinstance(c, Affine)
            else np.full(count(c, case.n), 2.0**0.5)
            for c in case.problem.constraints
        ]
    )
    open_ = np.maximum(depth[1:], depth[:-1])
    gained = np.diff(W, axis=0)
    apart = (open_ > BESIDE * floor) & (gained * open_ < 100.0 * floor * np.diff(case.t)[:, None])
    leaked = float((np.where(apart, gained, 0.0) * steep).sum())
    if leaked <= LEAK * method.comp_tol * min(1.0, _way(case, X)):
        return Status()
    return Status(
        "unverified",
        f"Constraints that do not touch have pushed by {leaked:.2g} in all, for gap x multiplier "
        f"is "
        f"{floor:.2g}, not zero: no smaller error is claimed; lower comp_tol.",
    )
