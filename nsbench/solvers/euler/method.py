"""Explicit and implicit Euler on a Filippov field, a hybrid or a smooth system.

Explicit steps chatter about a sliding surface, implicit ones do not.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from nsbench.case import Case
from nsbench.case.scale import time_text
from nsbench.compilation.factories import as_numpy, without_compilation
from nsbench.dynamics.length_scale import length_scale
from nsbench.problem import LCS, Complementarity, Filippov, Hybrid
from nsbench.solvers.base import Claims, Expect, Run, grid, last_steps
from nsbench.solvers.common.time_grid import samples
from nsbench.trajectory import STATES_BETWEEN, Resolution, Status, Trajectory

STANDARD = ("euler", "euler[implicit=true]")
LATE = (
    "a transition at the end of a step is late by any part of it: the error is O(h), and no power"
)
EXPLICIT = (
    Expect(("smooth",), 1.0, None, "without constraints and surfaces there is no multiplier"),
    Expect(("one_mode",), "open", None, LATE),
    Expect(("hybrid",), "open", "open", LATE),
    Expect(
        ("exact_at_grid",),
        "open",
        "open",
        "exact at some steps, O(h) chatter at others: no order describes both",
    ),
    Expect(
        ("zeno", "weak"),
        0.5,
        None,
        "the logarithm in h log(1 + a/h) / a, for steps near the contraction a; the limit is 1",
    ),
)
IMPLICIT = (
    Expect(("smooth",), 1.0, None, "without constraints and surfaces there is no multiplier"),
    Expect(
        ("exact_at_grid",),
        "exact",
        "exact",
        "every step is exact for fields that are constant in each mode",
    ),
    Expect(
        ("zeno", "weak"),
        0.5,
        None,
        "the logarithm in h log(1 + a/h) / a, for steps near the contraction a; the limit is 1",
    ),
)


@dataclass(frozen=True)
class Euler:
    """x+ = x + h F(t, x, s): explicit with s at the old state, implicit with F and s at the new
    one.

    Explicit: s_i is the sign of c_i(t, x), and +1 on the surface itself (c_i = 0 counts as the
    positive side).
    Implicit: s_i in Sgn(c_i(t + h, x+)), one small complementarity problem in each step: Newton's
    method for a sign pattern, pivots from the pattern of the last step, all 3^d patterns if they
    cycle. The impulse of surface i is the sum of h theta_i, theta = (1 + s) / 2. Between the modes
    the field is multilinear in s, made so where it is not. Where several solutions of the step
    exist (repulsive surfaces) the pattern of the last step wins; if that leads suddenly far, the
    nearest one (with at most five surfaces): fields that are stiff beyond a surface have solutions
    there too.
    Without switching surfaces both are the textbook methods. Hybrid systems: explicit alone, with
    transitions at the end of the step in which their guard passed zero.
    Source: Acary & Brogliato, Numerical Methods for Nonsmooth Dynamical Systems (2008), chapters 9
    and 10.
    """

    implicit: bool = False

    accuracy = "h"
    default = 1e-2
    scaled = True
    claims = Claims(state=1.0, impulse=1.0)

    @property
    def expects(self) -> tuple[Expect, ...]:
        """Return the orders expected for cases with a tag, explicit or implicit."""
        return IMPLICIT if self.implicit else EXPLICIT

    def __post_init__(self):
        if not isinstance(self.implicit, bool):
            raise ValueError(f"implicit is {self.implicit!r}; true or false")

    def refuses(self, case: Case) -> str | None:
        """Explain why the method does not take the case; None if it does."""
        p = case.problem
        if isinstance(p, Complementarity) and p.constraints:
            return "Euler has no way to keep g >= 0; use pbd or catching_up."
        if isinstance(p, LCS):
            return (
                "Euler takes Filippov systems, hybrid systems and plain smooth ones; this case is "
                "a linear complementarity system."
            )
        if isinstance(p, Hybrid) and self.implicit:
            return (
                "Implicit Euler has no step for transitions, whose mode would have to be known at "
                "its end; use euler or event_driven."
            )
        return None

    def prepare(self, case: Case, h: float) -> Run:
        """Bind the time loop to the case with the step h; return the run."""
        g = grid(case.t, h, last=case.exact_impulse is not None)
        if isinstance(case.problem, Hybrid):
            from nsbench.solvers.euler.hybrid_loop import HybridEuler

            return lambda: HybridEuler(case, g).run()
        from nsbench.compilation.case_functions import bind_loop
        from nsbench.solvers.euler.kernels import loop as kernel

        functions, d = _loop_functions(case)
        own = (_blends(case), length_scale(case, case.x0)) if self.implicit else ()
        args = (*functions.functions, *own, g.t, g.substeps, case.x0.copy(), d, _parts(g, d))
        march = bind_loop(
            kernel.implicit_euler if self.implicit else kernel.explicit_euler,
            functions.loop,
            args,
            without_compilation,
        )

        def run() -> Trajectory:
            with np.errstate(all="ignore"):
                return self._trajectory(case, g, functions.stats, march(*args))

        return run

    def _trajectory(self, case, g, loop, result):
        """Build the trajectory from what the time loop returned."""
        X, W, calls, inner, code, reached, looked = result
        lam = last_steps(case.t, g, W)
        between = _between(case, g, X, W, looked) if W.shape[1] else None
        if not g.aligned:
            X, W = samples(case.t, g.t, X, W)
        stats = {"steps": int(g.substeps.sum()), "h": g.h, "drift_calls": int(calls), **loop}
        if self.implicit:
            stats["inner_iterations"] = int(inner)
        status = _status(code, reached)
        smooth = isinstance(case.problem, Complementarity)
        return Trajectory(
            case.t,
            X,
            tuple((0, i) for i in range(W.shape[1])),
            W,
            np.where(np.isnan(X), np.nan, 0.0) if smooth else np.empty((len(X), 0)),
            status,
            stats=stats,
            lam_time="end" if self.implicit else "start",
            **lam,
            between=between,
            resolution=Resolution(step=g.h, rule="implicit" if self.implicit else "explicit"),
        )


def _parts(g, d: int) -> int:
    """Return in how many parts of each interval a state is stored: STATES_BETWEEN of a run or more.

    0 where there are no surfaces.
    """
    return -(-STATES_BETWEEN // (len(g.t) - 1)) if d else 0


def _between(case, g, X, W, looked):
    """Collect times, states and integrals that are known between samples.

    Those at nodes of the grid that are no samples, and those of the kernel.
    """
    n = X.shape[1]
    rows = looked.reshape(-1, looked.shape[2])
    rows = np.vstack([np.column_stack([g.t, X, W])[~np.isin(g.t, case.t)], rows])
    rows = rows[np.isfinite(rows).all(axis=1)]
    rows = rows[np.argsort(rows[:, 0])]
    return rows[:, 0], rows[:, 1 : 1 + n], rows[:, 1 + n :]


def _blends(case: Case) -> bool:
    """Must the field be made multilinear between its modes?"""
    from nsbench.dynamics.filippov.modes import is_multilinear

    return isinstance(case.problem, Filippov) and not is_multilinear(case.problem, case.n)


def _status(code, reached):
    """Return the status of a code of the time loop."""
    from nsbench.solvers.common.loop_status import status_of
    from nsbench.solvers.common.kernels.step_code import StepCode

    no_solution = Status(
        "maxiter",
        f"No solution of the implicit step from t = {time_text(reached, 6)} was found; try a "
        "smaller step.",
    )
    return status_of(code, reached, {StepCode.UNSOLVED: no_solution})


def _loop_functions(case):
    """Return field and switch functions for the time loop, and the number of surfaces."""
    from nsbench.compilation.case_functions import (
        compile_functions,
        drift_function,
        signed_field,
    )

    p = case.problem
    if isinstance(p, Complementarity):
        field = _no_signs(p.drift)
        switch = p.drift
        d = 0
    else:
        field = p.field
        switch = p.switch
        d = len(as_numpy(p.switch)(float(case.t[0]), case.x0.copy()))
    functions = signed_field(field, case.n, d), drift_function(switch, case.n)
    return compile_functions(*functions, start=(case.t[0], case.x0)), d


@functools.lru_cache(maxsize=256)
def _no_signs(drift):
    """Wrap a drift as a field without signs.

    The same object each time, so that what is compiled for it serves again.
    """

    def field(xp: Any) -> Callable:
        f = drift(xp)

        def g(t: float, x: np.ndarray, s: np.ndarray) -> np.ndarray:
            return f(t, x)

        return g

    return field


SOLVER = Euler
