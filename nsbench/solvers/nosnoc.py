"""nosnoc: finite elements with switch detection (FESD), one nonlinear program per step, solved by IPOPT. An extra."""
from __future__ import annotations

import contextlib
import importlib.util
import io
import warnings
from dataclasses import dataclass
from itertools import product
from typing import ClassVar

import numpy as np

from nsbench.case import Case
from nsbench.problem import LCS, Affine, Complementarity, Distance, Filippov
from nsbench.solvers.base import Claims, Run, check_positive
from nsbench.trajectory import Status, Trajectory

STANDARD = ()                   # 0.1 s a step: asked for by name
MOST = 10                       # contacts: from six on (four discs), steps were seen to fail or to be wrong
LABOUR, FIRST = 250, 5000       # iterations of IPOPT a step on average, from so many in all, that end a run: 85 a step are usual
UNSEEN = 100.0                  # tolerances by which a switch has to change to be seen
LEAK = 1000.0                   # tolerances by which the state may be pushed where nothing touches
BESIDE = 10.0                   # the same of a state that is on a surface
SUNK = 1e-3                     # depth below a constraint at which the push was too weak to hold


@dataclass(frozen=True)
class Nosnoc:
    """FESD of nosnoc (pip install "nsbench[nosnoc]") in steps of h, each of `elements` elements with `stages` Radau stages.

    Filippov systems in Stewart's form; complementarity systems, for which nosnoc has no class, in Heaviside's step form:
    x' = f + push sum_k (1 - alpha_k) grad g_k, alpha_k the step of g_k, which has the same solution as long as every
    multiplier is below `push`. comp_tol: tolerance of complementarity. Integrals of weights or multipliers are states.
    Claimed is the order of the Radau method, 2 stages - 1, which holds through switches until 1000 comp_tol; where what
    is left of complementarity can have moved the state by more, the run is unverified.
    Source: Nurkanovic, Sperl, Albrecht, Diehl, arXiv 2205.05337; Nurkanovic & Diehl, IEEE Control Systems Letters 2022.
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

    def refuses(self, case: Case) -> str | None:
        p = case.problem
        if isinstance(p, LCS):
            return "nosnoc takes Filippov and complementarity systems; this case is a linear complementarity system."
        if np.ptp(np.diff(case.t)) > 1e-9 * (case.t[-1] - case.t[0]):
            return "nosnoc is given steps of one length here; the sample times of this case are not equally spaced."
        why = _filippov(case) if isinstance(p, Filippov) else _constrained(case)
        if why is None and not (importlib.util.find_spec("nosnoc") and importlib.util.find_spec("casadi")):
            why = 'nosnoc is not installed; pip install "nsbench[nosnoc]" brings it and casadi.'
        return why or self._untold(case)

    def _untold(self, case):
        """Why casadi cannot build the case's functions; None if it can."""
        try:
            self._built(case)
        except (TypeError, ValueError, AttributeError, NotImplementedError) as e:
            return f"casadi cannot build the functions of {case.key} (do they use the array namespace they are given?): {e}."
        return None

    def _built(self, case):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")              # casadi warns of how nosnoc calls numpy
            return _model(case, self.push)

    def prepare(self, case: Case, h: float) -> Run:
        check_positive("h", h)
        spacing = float(case.t[-1] - case.t[0]) / (len(case.t) - 1)
        parts = max(1, int(np.ceil(spacing / h * (1.0 - 1e-9))))
        model, contacts, turning = self._built(case)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            solver = _solver(self, model, spacing / parts)
        return lambda: _march(case, self, solver, contacts, turning, parts, spacing / parts)


def _filippov(case):
    p = case.problem
    d = len(p.switch(np)(float(case.t[0]), case.x0.copy()))
    if d > 2:
        return f"Stewart's form needs all 2^d fields; this case has {d} surfaces, at most two are taken."
    f = p.field(np)
    twist = sum(a * b * f(float(case.t[0]), case.x0.copy(), np.array([a, b])) for a, b in product((1.0, -1.0), repeat=2)) \
        if d == 2 else np.zeros(1)
    if np.abs(twist).max() > 1e-12:
        return "Stewart's form is another system where the field is not affine in the signs of two surfaces."
    return None


def _constrained(case):
    p = case.problem
    if not p.constraints:
        return "nosnoc is for systems that switch; this case has neither constraints nor surfaces."
    if case.start != "error":
        return f'nosnoc starts on the feasible set; this case has start="{case.start}".'
    if not all(isinstance(c, (Affine, Distance)) for c in p.constraints):
        return "nosnoc is given affine constraints and distances here; this case has others."
    m = sum(_count(c, case.n) for c in p.constraints)
    return f"Every step would be a program with all {m} contacts; more than {MOST} are not taken." if m > MOST else None


def _count(c, n):
    if isinstance(c, Affine):
        return c.shape[0]
    many = c.particles(n)
    if c.pairs is not None:
        return len(c.pairs)
    return many * (many - 1) // 2 if c.anchors is None else many * np.shape(c.anchors if not c.moving else c.anchors(np)(0.0))[0]


def _model(case, push):
    """The nosnoc model, contact ids, and whether the reaction is integrated. States: x, time, integrals (, reaction)."""
    import casadi as ca
    import nosnoc

    from nsbench.solvers._casadi import Namespace, column, vector
    p, n, xp, t0 = case.problem, case.n, Namespace(), float(case.t[0])
    x, t = ca.SX.sym("x", n), ca.SX.sym("t")
    X, T = vector(x), vector(t)[0]
    if isinstance(p, Filippov):
        f, c = p.field(xp), column(p.switch(xp)(T, X))
        d = c.shape[0]
        modes = np.array(list(product((1.0, -1.0), repeat=d)))
        w = ca.SX.sym("w", d)
        F = ca.horzcat(*(ca.vertcat(column(f(T, X, s)), 1.0, *(0.5 * (1.0 + s))) for s in modes))
        x0 = np.concatenate((case.x0, [t0], np.zeros(d)))
        return (nosnoc.NosnocModel(x=ca.vertcat(x, t, w), x0=x0, F=[F], c=[c], S=[modes]), tuple((0, i) for i in range(d)),
                False)
    ids, gaps = zip(*_gaps(p, X, T, xp, n), strict=True)
    g, m = column(list(gaps)), len(ids)
    turning = any(isinstance(c, Distance) for c in p.constraints)
    alpha, w, r = ca.SX.sym("alpha", m), ca.SX.sym("w", m), ca.SX.sym("r", n if turning else 0)
    lam = push * (1.0 - alpha)
    force = ca.jacobian(g, x).T @ lam
    rhs = ca.vertcat(column(p.drift(xp)(T, X)) + force, 1.0, lam, force if turning else r)
    x0 = np.concatenate((case.x0, [t0], np.zeros(m + r.shape[0])))
    return nosnoc.NosnocModel(x=ca.vertcat(x, t, w, r), x0=x0, f_x=[rhs], alpha=[alpha], c=[g]), ids, turning


def _gaps(problem, x, t, xp, n):
    """(id, expression) of every constraint."""
    for k, c in enumerate(problem.constraints):
        if isinstance(c, Affine):
            A, b = _dense(c), c.b(xp)(t) if c.moving else c.b
            yield from (((k, i), A[i] @ x + b[i]) for i in range(len(A)))
            continue
        many = c.particles(n)
        P = x[c.start:c.start + many * c.dim].reshape(many, c.dim)
        anchors = None if c.anchors is None else (c.anchors(xp)(t) if c.moving else c.anchors)
        pairs = c.pairs if c.pairs is not None else (
            np.stack(np.triu_indices(many, 1), 1) if anchors is None else
            np.stack(np.meshgrid(np.arange(many), np.arange(len(anchors)), indexing="ij"), -1).reshape(-1, 2))
        for e, (i, j) in enumerate(pairs):
            u = P[i] - (P[j] if anchors is None else anchors[j])
            d = c.radii[i] + c.radii[j] if c.d is None else c.d[e] if c.d.ndim else float(c.d)
            yield (k, int(i), int(j)), c.sign * (xp.sqrt(sum(v * v for v in u)) - d)


def _dense(c):
    A = np.zeros(c.shape)
    A[np.repeat(np.arange(c.shape[0]), np.diff(c.indptr)), c.indices] = c.data
    return A


def _solver(method, model, step):
    import nosnoc
    o = nosnoc.NosnocOpts()
    o.pss_mode = nosnoc.PssMode.STEWART if model.F is not None else nosnoc.PssMode.STEP
    o.n_s, o.N_finite_elements, o.terminal_time, o.print_level = method.stages, method.elements, step, 0
    o.comp_tol = o.sigma_N = method.comp_tol
    o.step_equilibration = nosnoc.StepEquilibrationMode.HEURISTIC_MEAN
    shared = o.opts_casadi_nlp                           # by all that nosnoc solves in this process
    o.opts_casadi_nlp = {**shared, "ipopt": dict(shared["ipopt"]), "show_eval_warnings": False}
    o.tol_ipopt = 1e-2 * method.comp_tol
    return nosnoc.NosnocSolver(o, model)


def _march(case, method, solver, contacts, turning, parts, step):
    n, m, K = case.n, len(contacts), len(case.t)
    x = np.concatenate((case.x0, [float(case.t[0])], np.zeros(m + (n if turning else 0))))
    Y = np.full((K, len(x)), np.nan)
    Y[0], status, inner, steps = x, Status(), 0, 0
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")
        for k in range(1, K):
            for _ in range(parts):
                solver.set("x0", x)
                found = solver.solve()
                inner += int(np.nansum(np.array(found["nlp_iter"], dtype=float)))
                x = np.asarray(found["x_list"][-1], float)
                if "SUCCESS" not in str(found["status"]) or not np.all(np.isfinite(x)):
                    status = Status("maxiter", f"IPOPT did not solve a step between t = {case.t[k - 1]:.6g} and {case.t[k]:.6g}; "
                                               "other stages, elements or another h may help.")
                    break
                steps += 1
                if inner > max(FIRST, LABOUR * steps):
                    status = Status("maxiter", f"IPOPT took {inner} iterations for the {steps} steps up to t = {x[n]:.6g}, where "
                                               "85 a step are usual; other stages, elements or another h may help.")
                    break
            if not status.ok:
                break
            Y[k] = x
    X, W = Y[:, :n].copy(), Y[:, n + 1:n + 1 + m].copy()
    R = np.empty((K, 0))
    if isinstance(case.problem, Complementarity):
        R = Y[:, n + 1 + m:].copy() if turning else W @ np.vstack([_dense(c) for c in case.problem.constraints])
        if status.ok:
            status = _sunk(case, X)
        if status.ok:
            status = _leaks(case, method, X, W)
    elif status.ok:
        status = _unresolved(case, X, method.comp_tol)
    stats = {"steps": (K - 1) * parts, "h": step, "inner_iterations": inner, "loop": "host"}
    return Trajectory(case.t, X, tuple(contacts), W, R, status, stats=stats)


def _unresolved(case, X, tol):
    """Can each switch change by more than the tolerance of complementarity, over all that the run moves?"""
    from nsbench.solvers._doubts import pace
    from nsbench.solvers._flat_layer import flat_layer
    from nsbench.solvers._sliding import Motion
    motion, T = Motion(case.problem, float(case.t[0]), X[0].copy()), float(case.t[-1] - case.t[0])
    with np.errstate(all="ignore"):
        way = max(float(np.abs(X - X[0]).max()), T * pace(case.problem, float(case.t[0]), X[0]))
        slope = np.max([np.abs(motion.gradients(float(t), x, np.arange(motion.d))).sum(axis=1) * way
                        + np.abs(motion.along(float(t), x, 1.0, np.zeros(case.n))) * T
                        for t, x in zip(case.t, X, strict=True)], axis=0)
    row = int(np.argmin(slope))
    if slope[row] > UNSEEN * tol:
        flat = flat_layer(case, tol, X) or _lingers(case, X, tol, slope)
        return Status("unverified", f"{flat}: no error of that size is claimed there.") if flat else Status()
    return Status("unverified", f"Switch {row} changes by {slope[row]:.2g} in the run, which the tolerance of complementarity, "
                                f"{tol:.2g}, cannot tell from zero: scale it, or lower comp_tol.")


def _lingers(case, X, tol, slope) -> str:
    """Where a state is kept off a surface by what is left of complementarity, weight x distance = tol: where one field ends on
    the surface, that pushes it away by sqrt(2 tol x pace of the other), no small length; "" if nowhere."""
    c = np.abs([case.problem.switch(np)(float(t), x) for t, x in zip(case.t[1:], X[1:], strict=True)])
    found = np.argwhere((c > BESIDE * tol) & (c < np.sqrt(2.0 * tol * slope)))
    if not len(found):
        return ""
    at, row = found[0]
    return (f"At t = {case.t[at + 1]:.6g} the state is {c[at, row]:.2g} from surface {row}, as what is left of complementarity "
            f"({tol:.2g}) may keep it")


def _sunk(case, X):
    """Did the push hold every constraint?"""
    worst = min(min(float(g) for _, g in _gaps(case.problem, x, float(t), np, case.n)) for t, x in zip(case.t, X, strict=True))
    if worst >= -SUNK:
        return Status()
    return Status("infeasible", f"A constraint is violated by {-worst:.3g}: a multiplier is above the push; raise it.")


def _leaks(case, method, X, W) -> Status:
    """Have constraints pushed where they do not touch? gap x multiplier is comp_tol x push, not zero: while a gap opens slowly,
    or many are open for long, that adds up."""
    floor = method.comp_tol * method.push
    gaps = np.array([[float(g) for _, g in _gaps(case.problem, x, float(t), np, case.n)]
                     for t, x in zip(case.t, X, strict=True)])
    steep = np.concatenate([np.linalg.norm(_dense(c), axis=1) if isinstance(c, Affine) else np.full(_count(c, case.n), 2.0**0.5)
                            for c in case.problem.constraints])
    open_, gained = np.maximum(gaps[1:], gaps[:-1]), np.diff(W, axis=0)
    apart = (open_ > BESIDE * floor) & (gained * open_ < 100.0 * floor * np.diff(case.t)[:, None])
    leaked = float((np.where(apart, gained, 0.0) * steep).sum())
    if leaked <= LEAK * method.comp_tol:
        return Status()
    return Status("unverified", f"Constraints that do not touch have pushed by {leaked:.2g} in all, for gap x multiplier is "
                                f"{floor:.2g}, not zero: no smaller error is claimed; lower comp_tol.")


SOLVER = Nosnoc
