"""Finite elements with switch detection (FESD) by the package nosnoc: one nonlinear program a step.

IPOPT solves it. An extra: pip install "nsbench[nosnoc]".
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import warnings
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from nsbench.case import Case
from nsbench.problem import Complementarity, Filippov
from nsbench.solvers.base import Claims, Run, check_positive
from nsbench.solvers.nosnoc.model import dense, model, untold_contacts, untold_fields
from nsbench.trajectory import Resolution, Status, Trajectory

STANDARD = ()  # 0.1 s a step: asked for by name
SOLVED = 1e-2  # of comp_tol: tolerance of IPOPT
# iterations of IPOPT a step on average, from so many in all, that end a run: 85 a step are usual
LABOUR = 250
FIRST = 5000


@dataclass(frozen=True)
class Nosnoc:
    """FESD of nosnoc (pip install "nsbench[nosnoc]") in steps of h, each of `elements` elements
    with `stages` Radau stages.

    Filippov systems in Stewart's form; complementarity systems, for which nosnoc has no class, in
    Heaviside's step form:
    x' = f + push sum_k (1 - alpha_k) grad g_k, alpha_k the step of g_k, which has the same solution
    as long as every multiplier is below `push`. comp_tol: tolerance of complementarity. Integrals
    of weights or multipliers are states.
    Claimed is the order of the Radau method, 2 stages - 1, which holds through switches until 1000
    comp_tol; where what is left of complementarity can have moved the state by more, the run is
    unverified.
    Source: Nurkanovic, Sperl, Albrecht, Diehl, arXiv 2205.05337; Nurkanovic & Diehl, IEEE Control
    Systems Letters 2022.
    """

    stages: int = 3
    elements: int = 2
    comp_tol: float = 1e-10
    push: float = 10.0

    accuracy: ClassVar[str] = "h"
    default: ClassVar[float] = 0.1

    def __post_init__(self):
        for name, low, high in (("stages", 1, 9), ("elements", 1, 20)):
            v = getattr(self, name)
            if not (isinstance(v, int) and low <= v <= high):
                raise ValueError(f"{name} is {v!r}; a whole number from {low} to {high} is needed")
        for name in ("comp_tol", "push"):
            check_positive(name, getattr(self, name))

    @property
    def claims(self) -> Claims:
        return Claims(state=2.0 * self.stages - 1.0, impulse=2.0 * self.stages - 1.0)

    @property
    def step_tolerance(self) -> float:
        """The tolerance to which IPOPT solves every step."""
        return SOLVED * self.comp_tol

    @property
    def checks(self) -> tuple:
        """Checks of what the tolerances of nosnoc, which are absolute, may hide."""
        from nsbench.solvers.nosnoc.diagnostics import checks_of

        return checks_of(self)

    def refuses(self, case: Case) -> str | None:
        p = case.problem
        if not isinstance(p, (Complementarity, Filippov)):
            return f"nosnoc takes Filippov and complementarity systems; this case is a {p.kind}."
        if np.ptp(np.diff(case.t)) > 1e-9 * (case.t[-1] - case.t[0]):
            return (
                "nosnoc is given steps of one length here; the sample times of this case are "
                "not equally spaced."
            )
        why = untold_fields(case) if isinstance(p, Filippov) else untold_contacts(case)
        if why is None and not (
            importlib.util.find_spec("nosnoc") and importlib.util.find_spec("casadi")
        ):
            why = 'nosnoc is not installed; pip install "nsbench[nosnoc]" brings it and casadi.'
        return why or self._untold(case)

    def _untold(self, case):
        """Why casadi cannot build the case's functions; None if it can."""
        try:
            self._built(case)
        except (TypeError, ValueError, AttributeError, NotImplementedError) as e:
            return (
                f"casadi cannot build the functions of {case.key} (do they use the array "
                f"namespace they are given?): {e}."
            )
        return None

    def _built(self, case):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # casadi warns of how nosnoc calls numpy
            return model(case, self.push)

    def prepare(self, case: Case, h: float) -> Run:
        check_positive("h", h)
        spacing = float(case.t[-1] - case.t[0]) / (len(case.t) - 1)
        parts = max(1, int(np.ceil(spacing / h * (1.0 - 1e-9))))
        model, contacts, turning = self._built(case)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            solver = _solver(self, model, spacing / parts)
        return lambda: _march(case, self, solver, contacts, turning, parts, spacing / parts)


def _solver(method, model, step):
    import nosnoc

    o = nosnoc.NosnocOpts()
    o.pss_mode = nosnoc.PssMode.STEWART if model.F is not None else nosnoc.PssMode.STEP
    o.n_s = method.stages
    o.N_finite_elements = method.elements
    o.terminal_time = step
    o.print_level = 0
    o.comp_tol = o.sigma_N = method.comp_tol
    o.step_equilibration = nosnoc.StepEquilibrationMode.HEURISTIC_MEAN
    shared = o.opts_casadi_nlp  # by all that nosnoc solves in this process
    o.opts_casadi_nlp = {**shared, "ipopt": dict(shared["ipopt"]), "show_eval_warnings": False}
    o.tol_ipopt = method.step_tolerance
    return nosnoc.NosnocSolver(o, model)


def _march(case, method, solver, contacts, turning, parts, step) -> Trajectory:
    """Take all steps with the nosnoc solver of one step, and assemble the trajectory.

    The state of nosnoc is x (n,), the time, the integrals of the m weights or multipliers, and,
    where gradients turn, those of the reaction. parts: steps between two samples.
    """
    n = case.n
    m = len(contacts)
    K = len(case.t)
    x = np.concatenate((case.x0, [float(case.t[0])], np.zeros(m + (n if turning else 0))))
    Y = np.full((K, len(x)), np.nan)
    Y[0] = x
    every = [x]  # states after every step
    status = Status()
    inner = 0
    steps = 0
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
        for k in range(1, K):
            for _ in range(parts):
                solver.set("x0", x)
                found = solver.solve()
                inner += int(np.nansum(np.array(found["nlp_iter"], dtype=float)))
                x = np.asarray(found["x_list"][-1], float)
                if "SUCCESS" not in str(found["status"]) or not np.all(np.isfinite(x)):
                    status = _unsolved(case.t[k - 1], case.t[k])
                    break
                steps += 1
                every.append(x)
                if inner > max(FIRST, LABOUR * steps):
                    status = _laborious(inner, steps, x[n])
                    break
            if not status.ok:
                break
            Y[k] = x
    W = Y[:, n + 1 : n + 1 + m].copy()
    R = np.empty((K, 0))
    if isinstance(case.problem, Complementarity):
        R = (
            Y[:, n + 1 + m :].copy()
            if turning
            else W @ np.vstack([dense(c) for c in case.problem.constraints])
        )
    between = None
    if status.ok:
        every = np.array(every)
        times = np.append(_times(case.t, parts), case.t[-1])
        between = times, every[:, :n], every[:, n + 1 : n + 1 + m]
    stats = {"steps": (K - 1) * parts, "h": step, "inner_iterations": inner, "loop": "host"}
    return Trajectory(
        case.t,
        Y[:, :n].copy(),
        tuple(contacts),
        W,
        R,
        status,
        stats=stats,
        between=between,
        resolution=Resolution(step=step),
    )


def _unsolved(low: float, high: float) -> Status:
    return Status(
        "maxiter",
        f"IPOPT did not solve a step between t = {low:.6g} and {high:.6g}; "
        "other stages, elements or another h may help.",
    )


def _laborious(iterations: int, steps: int, t: float) -> Status:
    return Status(
        "maxiter",
        f"IPOPT took {iterations} iterations for the {steps} steps up to t = {t:.6g}, where "
        "85 a step are usual; other stages, elements or another h may help.",
    )


def _times(t, parts):
    """Return the times at which the steps begin."""
    return (t[:-1, None] + np.diff(t)[:, None] * np.arange(parts) / parts).ravel()


SOLVER = Nosnoc
