"""Catching up (Maury-Venel): explicit Euler, then the nearest point where the linearised gaps are
not negative."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nsbench.case import Case, nearest
from nsbench.problem import Complementarity, Smooth
from nsbench.qp.projection import large_problem_callback
from nsbench.solvers.base import Claims, Expect, Run, grid, last_steps, sample
from nsbench.solvers.catching_up.qp_backends import BACKENDS
from nsbench.solvers.common.divergence import classify_divergence
from nsbench.solvers.common.initial_state import initial_state
from nsbench.trajectory import Resolution, Status, Trajectory

# a length (of the largest one, if that is below 1); a step with more did not solve its problem
KKT = 1e-6
CODES = {0: "ok", 1: "nan", 3: "infeasible"}
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


@dataclass(frozen=True)
class CatchingUp:
    """z = x + h f(t, x); y nearest to z with g_k(t + h, x) + grad g_k(t + h, x) . (y - x) >= 0;
    impulses: the duals.

    backend: "active_set" (own, exact, the whole time loop compiled where the drift compiles),
    "osqp", "piqp".
    nonlinear: project on {g >= 0} itself, y - z = sum mu_k grad g_k(t + h, y), by successive
    linearisation to 1e-12.
    eps, max_iter: tolerance and iteration limit of a library backend. reach: margin of the near
    lists in mean radii; the step does not depend on it. Every solution is checked by its KKT
    residual, formula in kernels.qp.residual; the worst is in stats["kkt"]; above 1e-6 the run is
    "unverified". Steps that hit a limit are counted in stats["limits"].
    Source: Maury & Venel, ESAIM: M2AN 45(1), 2011; order 1/2 proved by Bernicot & Venel, SIAM J.
    Control Optim. 51(4), 2013.
    """

    backend: str = "active_set"
    nonlinear: bool = False
    eps: float | None = None
    max_iter: int | None = None
    reach: float = 0.3

    accuracy = "h"
    default = 1e-2
    claims = Claims(state=1.0, impulse=1.0)
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

    def refuses(self, case: Case) -> str | None:
        if not isinstance(case.problem, Complementarity):
            return "Catching up needs constraints to project on; this case is a " + (
                "Filippov system."
                if type(case.problem).__name__ == "Filippov"
                else "linear complementarity system."
            )
        if not case.problem.constraints:
            return (
                "Catching up needs constraints to project on; this case has none (it would be "
                "explicit Euler: use euler)."
            )
        return None

    def prepare(self, case: Case, h: float) -> Run:
        from nsbench.dynamics.contacts.constraint_set import ConstraintSet

        g = grid(case.t, h, last=case.exact_impulse is not None)
        scene = ConstraintSet(case.problem, case.n)
        x0 = initial_state(case, scene)
        reach = self.reach * _mean_radius(scene)
        smooth = any(isinstance(c, Smooth) for c in scene.families)
        if self.backend == "active_set" and not smooth and not self.nonlinear:
            march, loop = _compiled(case, scene, g, x0, reach)
            again = lambda fine, x: _compiled(case, scene, fine, x, reach)[0]()[0]
        else:
            from nsbench.solvers.catching_up.host_loop import HostLoop

            loop = "host"
            made = (self.backend, self.nonlinear, reach, self.eps, self.max_iter)
            march = HostLoop(case, scene, g, x0, *made).run
            again = lambda fine, x: HostLoop(case, scene, fine, x, *made).run()[0]
        return lambda: _trajectory(case, g, loop, march(), again)


def _mean_radius(scene) -> float:
    return float(np.mean(np.concatenate(list(scene.radii.values())))) if scene.hard else 1.0


def _projectors(scene):
    """The functions of kernels.least; the one for many rows is compiled where there can be many."""
    from nsbench.qp.kernels import exact_callback

    return exact_callback.solve_exact, large_problem_callback(
        len(scene.all_static()) + 3 * sum(m for _, _, m in scene.hard)
    )  # discs: 3 contacts each


def _compiled(case, scene, g, x0, reach):
    """The compiled loop bound to its data, and "compiled" or "host": the same loop around a drift
    in Python."""
    from nsbench.solvers.catching_up.kernels import loop as kernel
    from nsbench.solvers.pbd.method import _hard, _pointers, _types

    t0 = float(case.t[0])
    pointers, loop = _pointers(case, scene)
    hard, radii = _hard(scene)[:2] if scene.hard else (np.empty((0, 4), np.int64), np.empty(0))
    rows = (scene.ptr, scene.cols, scene.vals)
    args = (
        *pointers,
        *_projectors(scene),
        scene.moving,
        g.t.copy(),
        g.substeps,
        x0,
        scene.all_static().arrays(),
        rows,
        scene.b(t0),
        scene.anchors(t0),
        hard,
        radii,
        reach,
    )
    march = kernel.march if loop == "compiled" else kernel.march.py_func
    if loop == "compiled":
        march.compile(_types(args))

    def run():
        X, R, ids, values, count, worst, when, code, reached = march(*args)
        count = {
            key: int(count[at])
            for at, key in enumerate(
                (
                    "qp_solves",
                    "inner_iterations",
                    "rebuilds",
                    "contacts_peak",
                    "limits",
                    "ties",
                    "rounds_worst",
                    "contacts",
                )
            )
        }
        count["contacts"] = round(count["contacts"] / max(1, int(g.substeps.sum())))
        return X, R, ids, values, count, worst, when, CODES[code], reached

    return run, loop


def _trajectory(case, g, loop, out, again):
    from nsbench.dynamics.contacts.kernels.impulse_records import cumulate

    X, R, ids, values, work, worst, when, code, reached = out
    contacts, impulse = cumulate(ids, values, len(g.t))
    impulse[~np.isfinite(X[:, 0])] = np.nan
    steps = int(g.substeps.sum())
    stats = {
        "steps": steps,
        "h": g.h,
        "drift_calls": steps,
        "loop": loop,
        "kkt": float(worst),
        **work,
    }
    status = (
        classify_divergence(g, X, reached, again)
        if code == "nan"
        else _status(
            code, stats, when, reached, max(np.nanmax(np.abs(a), initial=0.0) for a in (X, R))
        )
    )
    lam = last_steps(case.t, g, impulse)
    if not g.aligned:
        X, R, impulse = (sample(case.t, g.t, v) for v in (X, R, impulse))
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
        resolution=Resolution(step=g.h, rule="explicit"),
    )


def _status(code, stats, when, reached, size):
    if code == "unsettled":
        return Status(
            "maxiter",
            f"{stats['limits']} nonlinear steps up to t = {reached:.6g} did not settle: shorter "
            f"steps, or "
            "linearised ones (without nonlinear=true), may.",
        )
    if code == "infeasible":
        return Status(
            "infeasible",
            f"The QP of the step from t = {reached:.6g} has no feasible point: the linearised "
            "constraints contradict each other.",
        )
    if not stats["kkt"] <= KKT * min(1.0, float(size) or 1.0):
        return Status(
            "unverified",
            f"The QP of the step from t = {when:.6g} was solved with a KKT residual of "
            f"{stats['kkt']:.2g} only; {stats['limits']} steps hit the iteration limit.",
        )
    if stats["ties"]:
        return Status(
            "degenerate", "Coincident centres: the contact has no normal; the first axis was taken."
        )
    return Status()


SOLVER = CatchingUp
