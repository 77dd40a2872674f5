"""Catching up (Maury-Venel): explicit Euler, then projection on the linearised constraints.

    z = x + h f(t, x)
    x+ = argmin |y - z|^2    subject to    g_k(t + h, x) + grad g_k(t + h, x) . (y - x) >= 0

The multipliers of the projection are the impulses of the step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.case import Case, nearest
from nsbench.case.scale import time_text
from nsbench.problem import Complementarity, Smooth
from nsbench.qp.projection import large_problem_callback
from nsbench.solvers.base import Expect, Run, grid, last_steps
from nsbench.solvers.catching_up.outcome import Outcome
from nsbench.solvers.catching_up.qp_backends import BACKENDS
from nsbench.solvers.common.divergence import classify_divergence
from nsbench.solvers.common.initial_state import initial_state
from nsbench.solvers.common.time_grid import between_samples, check_positive, samples
from nsbench.solvers.common.tolerance_run import StepOrTolerance
from nsbench.trajectory import Resolution, Status, Trajectory

# KKT residual, a length (over the largest one, if that is below 1), above which a step did not
# solve its problem
MAX_KKT = 1e-6
COUNTERS = (  # in the order of kernels/projection_step.py
    "qp_solves",
    "inner_iterations",
    "rebuilds",
    "contacts_peak",
    "limits",
    "ties",
    "rounds_worst",
    "contacts",
)
EXPECTS = (
    Expect(
        ("exact_at_grid",),
        "exact",
        "exact",
        "every step of Euler is exact for a drift that is constant in each mode",
    ),
    Expect(
        ("constant_force",),
        "exact",
        "exact",
        "drift and gradients are constant along the motion: steps are exact at "
        "grid times, whatever the number of contacts",
    ),
    Expect(
        ("infeasible_start",),
        None,
        None,
        "what a method makes of an infeasible start is its meaning, not its error",
    ),
)
# with fixed steps, and with steps that are chosen for a tolerance
STANDARD = ("catching_up", "catching_up[tol=1e-2]")


@dataclass(frozen=True)
class CatchingUp(StepOrTolerance):
    """Step by explicit Euler and the nearest point of the linearised constraints.

    backend: "active_set" (own, exact, the whole time loop compiled where the drift compiles),
    "osqp", "piqp".
    nonlinear: project on {g >= 0} itself, y - z = sum mu_k grad g_k(t + h, y), by successive
    linearisation to 1e-12.
    eps, max_iter: tolerance and iteration limit of a library backend. reach: margin of the
    neighbour lists in mean radii; the step does not depend on it. tol: steps are chosen along the
    run so that its error bars stay below a tolerance, as of pbd. Every solution is checked by its
    KKT residual (qp.kernels.active_set.residual); the worst is in stats["kkt"]; above 1e-6 the run
    is "unverified". Steps that hit a limit are counted in stats["limits"].
    Source: Maury & Venel, ESAIM: M2AN 45(1), 2011; order 1/2 proved by Bernicot & Venel, SIAM J.
    Control Optim. 51(4), 2013.
    """

    backend: str = "active_set"
    nonlinear: bool = False
    eps: float | None = None
    max_iter: int | None = None
    reach: float = 0.3
    tol: float | None = None

    expects = EXPECTS

    def __post_init__(self):
        if self.backend not in BACKENDS:
            raise ValueError(f"backend is {self.backend!r}; {nearest(str(self.backend), BACKENDS)}")
        if not isinstance(self.nonlinear, bool):
            raise ValueError(f"nonlinear is {self.nonlinear!r}; true or false")
        if self.backend == "active_set" and (self.eps, self.max_iter) != (None, None):
            raise ValueError(
                "eps and max_iter belong to a library backend; the active set has neither"
            )
        if self.eps is not None and not 0 < self.eps < 1:
            raise ValueError(f"eps is {self.eps!r}; a number between 0 and 1 is needed")
        if self.max_iter is not None and not (
            isinstance(self.max_iter, int) and self.max_iter >= 1
        ):
            raise ValueError(f"max_iter is {self.max_iter!r}; a positive whole number is needed")
        if not self.reach > 0:
            raise ValueError(f"reach is {self.reach!r}; a positive number is needed")
        if self.tol is not None:
            check_positive("tol", self.tol)

    @property
    def scaled(self) -> bool:
        """Steps are made in own units; a tolerance is one in those of the user."""
        return self.tol is None

    def refuses(self, case: Case) -> str | None:
        if not isinstance(case.problem, Complementarity):
            kind = case.problem.kind
            return f"Catching up needs constraints to project on; this case is a {kind}."
        if not case.problem.constraints:
            return (
                "Catching up needs constraints to project on; this case has none (it would be "
                "explicit Euler: use euler)."
            )
        return self.refuses_tolerance(case)

    def prepare(self, case: Case, h: float) -> Run:
        if self.tol is not None:
            return self.prepare_tolerance(case, h)
        from nsbench.dynamics.contacts.constraint_set import ConstraintSet
        from nsbench.solvers.common.hard_particles import mean_radius

        g = grid(case.t, h, last=case.exact_impulse is not None, states=case.n)
        scene = ConstraintSet(case.problem, case.n)
        x0 = initial_state(case, scene)
        reach = self.reach * mean_radius(scene)
        smooth = any(isinstance(c, Smooth) for c in scene.families)
        if self.backend == "active_set" and not smooth and not self.nonlinear:
            march, loop = _compiled(case, scene, g, x0, reach)
            again = lambda fine, x: _compiled(case, scene, fine, x, reach)[0]().x
        else:
            from nsbench.compilation.case_functions import in_python
            from nsbench.solvers.catching_up.host_loop import HostLoop

            loop = in_python(self._why_in_python(smooth))
            options = (self.backend, self.nonlinear, reach, self.eps, self.max_iter)
            march = HostLoop(case, scene, g, x0, *options).run
            again = lambda fine, x: HostLoop(case, scene, fine, x, *options).run().x
        return lambda: _trajectory(case, g, loop, march(), again)

    def _why_in_python(self, has_smooth: bool) -> str:
        if has_smooth:
            return "Smooth constraints are linearised there"
        if self.nonlinear:
            return "nonlinear steps are solved by sequential quadratic programmes there"
        return f"the backend {self.backend} is called from there"


def _projectors(scene):
    """Return the functions for small and for large problems, the latter if these can occur."""
    from nsbench.qp.kernels import active_set_callback

    return active_set_callback.solve_exact, large_problem_callback(
        len(scene.all_static()) + 3 * sum(m for _, _, m in scene.hard)
    )  # discs: 3 contacts each


def _compiled(case, scene, g, x0, reach):
    """Return the time loop bound to its data, and what the run says of it."""
    from nsbench.dynamics.contacts.kernels.contact_arrays import AffineRows
    from nsbench.solvers.catching_up.kernels import loop as kernel
    from nsbench.compilation.case_functions import (
        bind_loop,
        compile_functions,
        curve_function,
        drift_function,
        module_in_python,
    )
    from nsbench.solvers.common.hard_particles import hard_particles
    from nsbench.solvers.common.kernels.step_code import StepCode

    t0 = float(case.t[0])
    anchors = scene.anchors(t0)
    functions = compile_functions(
        drift_function(case.problem.drift, case.n),
        curve_function(scene.b_factory, scene.inv2.size, scene.b),
        curve_function(scene.anchor_factory, anchors.size, scene.anchors),
        start=(t0, x0),
    )
    hard = hard_particles(scene)
    args = (
        *functions.functions,
        *_projectors(scene),
        scene.moving,
        g.t.copy(),
        g.substeps,
        x0,
        scene.all_static().arrays(),
        AffineRows(scene.ptr, scene.cols, scene.vals, scene.inv2),
        scene.b(t0),
        anchors,
        hard.families,
        hard.radii,
        reach,
    )
    march = bind_loop(kernel.march, functions.loop, args, module_in_python)

    def run() -> Outcome:
        out = march(*args)
        work = dict(zip(COUNTERS, out.counters.tolist(), strict=True))
        work["contacts"] = round(work["contacts"] / max(1, int(g.substeps.sum())))
        code = {StepCode.OK: "ok", StepCode.NAN: "nan", StepCode.INFEASIBLE: "infeasible"}[out.code]
        return Outcome(
            out.x, out.reaction, out.ids, out.values, work, out.worst, out.when, code, out.reached
        )

    return run, functions.stats


def _trajectory(case, g, loop, out, again):
    from nsbench.dynamics.contacts.kernels.impulse_records import cumulate

    X = out.x
    R = out.reaction
    contacts, impulse = cumulate(out.ids, out.values, len(g.t))
    impulse[~np.isfinite(X[:, 0])] = np.nan
    steps = int(g.substeps.sum())
    stats = {
        "steps": steps,
        "h": g.h,
        "drift_calls": steps,
        **loop,
        "kkt": float(out.worst),
        **out.work,
    }
    status = (
        classify_divergence(g, X, out.reached, again)
        if out.code == "nan"
        else _status(out, stats, max(np.nanmax(np.abs(a), initial=0.0) for a in (X, R)))
    )
    lam = last_steps(case.t, g, impulse)
    between = between_samples(case.t, g, X, impulse)
    if not g.aligned:
        X, R, impulse = samples(case.t, g.t, X, R, impulse)
    # the drift that the multiplier balances is taken at the start of the step
    return Trajectory(
        case.t,
        X,
        contacts,
        impulse,
        R,
        status,
        stats=stats,
        lam_time="start",
        **lam,
        between=between,
        resolution=Resolution(step=g.h, rule="explicit"),
    )


def _status(out, stats, size):
    """Return the status of a run whose states and reactions are at most `size`."""
    if out.code == "unsettled":
        return Status(
            "maxiter",
            f"{stats['limits']} nonlinear steps up to t = {time_text(out.reached, 6)} did not "
            "settle: "
            "shorter steps, or linearised ones (without nonlinear=true), may.",
        )
    if out.code == "infeasible":
        return Status(
            "infeasible",
            f"The QP of the step from t = {time_text(out.reached, 6)} has no feasible point: the "
            "linearised "
            "constraints contradict each other.",
        )
    if not stats["kkt"] <= MAX_KKT * min(1.0, float(size) or 1.0):
        return Status(
            "unverified",
            f"The QP of the step from t = {time_text(out.when, 6)} was solved with a KKT residual "
            "of "
            f"{stats['kkt']:.2g} only; {stats['limits']} steps hit the iteration limit.",
        )
    if stats["ties"]:
        return Status(
            "degenerate", "Coincident centres: the contact has no normal; the first axis was taken."
        )
    return Status()


SOLVER = CatchingUp
