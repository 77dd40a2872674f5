"""Implicit theta stepping for linear complementarity systems and linear constraints.

One linear complementarity problem is solved per step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.case import Case
from nsbench.case.scale import time_text
from nsbench.compilation.factories import as_numpy
from nsbench.problem import LCS, Affine, Complementarity
from nsbench.solvers.base import Claims, Expect, Run, grid, last_steps
from nsbench.solvers.common.time_grid import between_samples, samples
from nsbench.trajectory import Resolution, Status, Trajectory

ALL = 8  # rows whose 2^m supports are tried in each step where uniqueness is not certain


@dataclass(frozen=True)
class Theta:
    """x+ = x + h ((1 - theta) f(t, x) + theta f(t + h, x+) + B lam): one complementarity problem
    for lam per step.

    theta 1: implicit Euler, order 1, lam belongs to the end of the step. theta 0.5: the trapezoid,
    order 2, lam belongs to the middle; steps in which lam jumps (relays) cost O(h) for any theta.
    Rows that constrain the state alone (D = 0;
    gaps) hold at the end of the step, rows that say what lam is hold in the mean: kernels.theta
    says how they are told apart. Of several lam with the same motion the smallest is taken.
    Newton's method solves a drift that is not affine.
    Source: Han, Tiwari, Camlibel & Pang, SIAM J. Numer. Anal. 47(5), 2009 (least-norm steps of
    passive systems); Acary & Brogliato, Numerical Methods for Nonsmooth Dynamical Systems (2008),
    section 9.4.
    """

    theta: float = 1.0

    accuracy = "h"
    default = 1e-2
    scaled = True
    has_error_bars = True
    expects = (
        Expect(
            ("exact_at_grid",),
            "exact",
            "exact",
            "the drift is constant in each mode: its steps are exact",
        ),
        Expect(
            ("constant_force",),
            "exact",
            "exact",
            "drift and gradients are constant: steps are exact at grid "
            "times, whatever the number of contacts",
        ),
    )

    def __post_init__(self):
        if (
            isinstance(self.theta, bool)
            or not isinstance(self.theta, (int, float))
            or not 0.5 <= self.theta <= 1.0
        ):
            raise ValueError(f"theta is {self.theta!r}; a number from 0.5 to 1 is needed")
        object.__setattr__(self, "theta", float(self.theta))

    @property
    def claims(self) -> Claims:
        """Return the claimed orders: 2 for the trapezoid, else 1."""
        order = 2.0 if self.theta == 0.5 else 1.0
        return Claims(state=order, impulse=order)

    def refuses(self, case: Case) -> str | None:
        """Explain why the method does not take the case; None if it does."""
        p = case.problem
        if isinstance(p, LCS):
            from nsbench.dynamics.lcs import inconsistent

            return inconsistent(case)
        if not isinstance(p, Complementarity):
            return (
                "theta takes linear complementarity systems and linear constraints; this case "
                f"is a {p.kind}."
            )
        if not p.constraints:
            return "theta needs constraints; this case has none (use euler[implicit=true])."
        if any(not isinstance(c, Affine) for c in p.constraints):
            return (
                "theta solves linear complementarity problems; this case has constraints that are "
                "not linear in x "
                "(use catching_up)."
            )
        return None

    def prepare(self, case: Case, h: float) -> Run:
        """Bind the time loop to the case with the step h; return the run."""
        from nsbench.compilation.case_functions import bind_loop, module_in_python
        from nsbench.solvers.theta.kernels import loop as kernel

        g = grid(case.t, h, last=case.exact_impulse is not None, states=case.n)
        data = _of_lcs(case) if isinstance(case.problem, LCS) else _of_gaps(case)
        functions = _loop_functions(case, data)
        B = data["B"]
        C = data["C"]
        D = data["D"]
        fixed = ~D.any(axis=1)
        jumpy = fixed & ~np.array([row @ col for row, col in zip(C, B.T, strict=True)], bool)
        unique = data["J"] is None or _unique(data, g.h, self.theta, fixed)
        J = np.zeros((case.n, case.n)) if data["J"] is None else data["J"]
        args = (
            *functions.functions,
            data["q"] is not None,
            data["J"] is not None,
            J,
            g.t.copy(),
            g.substeps,
            data["x0"],
            data["q0"],
            B,
            C,
            D,
            self.theta,
            fixed,
            jumpy,
            not unique and len(fixed) <= ALL,
        )
        march = bind_loop(kernel.march, functions.loop, args, module_in_python)
        return lambda: _trajectory(
            case, g, functions.stats, self.theta, B, unique or len(fixed) <= ALL, march(*args)
        )


def _of_lcs(case: Case) -> dict:
    """Return the matrices and functions of a linear complementarity system."""
    from nsbench.dynamics.lcs import drift_of, inputs

    p = case.problem
    return {
        "f": drift_of(p),
        "q": p.q,
        "q0": inputs(p)[1](float(case.t[0])).copy(),
        "x0": case.x0.copy(),
        "J": np.array(p.A),
        "B": np.array(p.B),
        "C": np.array(p.C),
        "D": np.array(p.D),
    }


def _of_gaps(case: Case) -> dict:
    """Return affine constraints in the form of an LCS: w = C x + q(t) with B = C^T, D = 0."""
    from nsbench.dynamics.contacts.constraint_set import ConstraintSet
    from nsbench.dynamics.contacts.time_dependence import concatenate_curves
    from nsbench.solvers.common.initial_state import initial_state

    families = case.problem.constraints
    blocks = []
    for c in families:
        block = np.zeros(c.shape)
        block[np.repeat(np.arange(c.shape[0]), np.diff(c.indptr)), c.indices] = c.data
        blocks.append(block)
    q = concatenate_curves([c.b for c in families])
    t0 = float(case.t[0])
    C = np.vstack(blocks)
    q0 = np.concatenate([np.ravel(as_numpy(c.b)(t0) if c.moving else c.b) for c in families])
    return {
        "f": case.problem.drift,
        "q": q,
        "q0": q0,
        "x0": initial_state(case, ConstraintSet(case.problem, case.n)),
        "J": None,
        "B": np.ascontiguousarray(C.T),
        "C": C,
        "D": np.zeros((len(C), len(C))),
    }


def _loop_functions(case, data):
    """Return the drift and the curve q(t) of the case for the time loop."""
    from nsbench.compilation.case_functions import (
        compile_functions,
        curve_function,
        drift_function,
    )

    return compile_functions(
        drift_function(data["f"], case.n),
        curve_function(data["q"], len(data["q0"])),
        start=(case.t[0], case.x0),
    )


def _unique(data, h, theta, fixed):
    """Is the motion of every step certain to be the only one, whichever rows hold at the end?"""
    from nsbench.dynamics.lcs import certainly_unique
    from nsbench.solvers.theta.kernels.step_matrices import matrices

    G = np.zeros(data["B"].shape)
    if not matrices(data["J"], h, theta, data["B"], np.zeros(data["J"].shape), G):
        return False
    ends = [np.diag(fixed.astype(float)), np.eye(len(fixed))]
    m = len(fixed)
    return all(
        certainly_unique(data["D"] + (theta * np.eye(m) + (1.0 - theta) * E) @ (data["C"] @ G), G)
        for E in ends
    )


def _trajectory(case, g, loop, theta, B, judged, out):
    """Build the trajectory from what the time loop returned."""
    from nsbench.solvers.theta.kernels.loop import CALLS, INNER, LCPS, PIVOTS, UNSETTLED

    X, P, count, code, reached, twice = out
    if isinstance(case.problem, LCS):
        contacts = tuple((0, i) for i in range(P.shape[1]))
    else:
        contacts = tuple(
            (k, i) for k, c in enumerate(case.problem.constraints) for i in range(c.shape[0])
        )
    acted = np.flatnonzero(np.any(P > 0.0, axis=0)) if contacts else np.empty(0, int)
    R = P @ B.T
    R[~np.isfinite(X[:, 0])] = np.nan
    stats = {
        "steps": int(g.substeps.sum()),
        "h": g.h,
        "drift_calls": int(count[CALLS]),
        **loop,
        "qp_solves": int(count[LCPS]),
        "inner_iterations": int(count[INNER]),
        "pivots": int(count[PIVOTS]),
        "limits": int(count[UNSETTLED]),
    }
    lam = last_steps(case.t, g, P[:, acted])
    between = between_samples(case.t, g, X, P[:, acted])
    if not g.aligned:
        X, P, R = samples(case.t, g.t, X, P, R)
    label = {1.0: "end", 0.5: "midpoint"}.get(theta, "mean")
    return Trajectory(
        case.t,
        X,
        tuple(contacts[i] for i in acted),
        P[:, acted],
        R,
        _status(code, reached, twice, judged),
        stats=stats,
        lam_time=label,
        **lam,
        between=between,
        resolution=Resolution(step=g.h, rule="explicit" if theta == 0.0 else "implicit"),
    )


def _status(code, reached, twice, judged):
    """Return the status of a run: by its code, else by the uniqueness of its steps."""
    from nsbench.solvers.common.loop_status import status_of
    from nsbench.solvers.common.kernels.step_code import StepCode

    at = f"t = {time_text(reached, 6)}"
    own = {
        StepCode.NEWTON_LIMIT: Status(
            "maxiter",
            f"Newton's method found no solution of the implicit step from {at}; try a smaller "
            f"step.",
        ),
        StepCode.INFEASIBLE: Status(
            "infeasible", f"The complementarity problem of the step from {at} has no solution."
        ),
        StepCode.JUMP: Status(
            "infeasible",
            f"At {at} a row of w reached zero that its own lambda does not move at once: the "
            "state would have to jump.",
        ),
    }
    status = status_of(code, reached, own)
    if not status.ok:
        return status
    if twice == twice:
        return Status(
            "degenerate",
            f"The step from t = {time_text(twice, 6)} has several solutions with different "
            "motions.",
        )
    if not judged:
        return Status(
            "unverified",
            f"Each step has a solution; for more than {ALL} rows of this kind it is not known "
            "whether its motion is the only one.",
        )
    return Status()


SOLVER = Theta
