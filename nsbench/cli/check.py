"""`nsbench check`: does a case file or a solver file keep the contract? Each thing not met is a
sentence."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from nsbench import solvers
from nsbench.case import Case, get_case, load_case, load_module
from nsbench.compilation.factories import as_numpy
from nsbench.problem import LCS, Complementarity, Filippov

PROBES = ("tide", "sliding", "three_discs")


def check_file(path: Path, say) -> list[str]:
    """What is not met, as sentences; `say` tells what was looked at. Whatever the file raises is a
    sentence too."""
    try:
        return _check_file(path, say)
    except (FileNotFoundError, KeyboardInterrupt):
        raise
    except (Exception, SystemExit) as e:
        return [f"{type(e).__name__}: {e}"]


def _check_file(path: Path, say) -> list[str]:
    module = load_module(path)
    if hasattr(module, "SOLVER"):
        return check_solver(path, say)
    if hasattr(module, "CASE") or hasattr(module, "make"):
        return check_case(load_case(path), say)
    return [f"{path} defines none of CASE, make, SOLVER"]


def check_case(case: Case, say) -> list[str]:
    """Start, drift in all namespaces, exact solution against its own equation, and that a method
    accepts it."""
    out = []
    if not case.doc:
        out.append("the file has no docstring: state the equations")
    out += _start(case)
    out += _namespaces(case)
    if case.exact is not None:
        out += _exact(case) or _second_opinion(case)
    takers = [s for s in solvers.standard() if solvers.get(s).refuses(case) is None]
    if not takers:
        out.append("every method of the standard suite refuses it")
    say(
        f"{case.key}: n = {case.n}, {len(case.t)} samples, exact solution: "
        f"{'yes' if case.exact else 'no'}, "
        f"methods: {', '.join(takers)}"
    )
    return out


def _start(case):
    from nsbench.dynamics.contacts.constraint_set import ConstraintSet
    from nsbench.solvers.common.initial_state import initial_state

    if not isinstance(case.problem, Complementarity):
        return []
    try:
        initial_state(case, ConstraintSet(case.problem, case.n))
    except ValueError as e:
        return [str(e)]
    return []


def _namespaces(case):
    """The drift in numba and JAX against numpy at the start."""
    from nsbench.compilation import factories

    if isinstance(case.problem, LCS):
        return []
    t = float(case.t[0])
    x = np.array(case.x0)
    out = []
    if isinstance(case.problem, Filippov):
        s = np.ones(len(np.asarray(as_numpy(case.problem.switch)(t, x))))
        factory = case.problem.field
        args = (t, x, s)
    else:
        factory = case.problem.drift
        args = (t, x)
    want = factories.as_numpy(factory)(*args)
    try:
        pointer = (
            factories.rhs_cfunc(factory, case.n)
            if len(args) == 2
            else factories.signed_rhs_cfunc(factory, case.n, len(s))
        )
        got = np.empty(case.n)
        import numba

        call = numba.njit(lambda f, *a: f(*a))
        call(pointer, *args, got)
        if not np.allclose(got, want, rtol=1e-13, atol=1e-13, equal_nan=True):
            out.append(
                f"the drift compiled by numba differs from numpy by {np.abs(got - want).max():.3g}"
            )
    except factories.CompileError as e:
        out.append(f"numba cannot compile the drift, runs will be slow: {e}")
    try:
        got = np.asarray(factories.as_jax(factory)(*args))
        if not np.allclose(got, want, rtol=1e-13, atol=1e-13, equal_nan=True):
            out.append(f"the drift in JAX differs from numpy by {np.abs(got - want).max():.3g}")
    except Exception as e:  # whatever JAX raises on a drift that is not written for it
        out.append(
            f"JAX cannot run the drift, so penalty cannot: {type(e).__name__}: "
            f"{str(e).splitlines()[0]}"
        )
    return out


def _second_opinion(case):
    """The exact solution, impulse and events against the event-driven method, which knows nothing
    of them."""
    from nsbench.measure import errors

    method = solvers.get("event_driven")
    if method.refuses(case):
        return []
    traj = solvers.solve(case, "event_driven")
    if not traj.status.ok:
        return [f"event_driven cannot confirm the exact solution: {traj.status}"]
    try:
        found = errors(case, traj)
        out = []
    except ValueError as e:  # a certificate of this case says otherwise
        return [str(e)]
    for name, what, limit in (
        ("state_sup", "exact(t)", 1e-8),
        ("impulse", "exact_impulse(t)", 1e-7),
        ("event_time", "exact_events", 1e-7),
    ):
        size = (
            found["state_scale" if name == "state_sup" else "impulse_scale"]
            if name != "event_time"
            else 1.0
        )
        if found[name] > limit * size:
            out.append(
                f"event_driven differs from {what} by {found[name]:.3g}; one of the two is wrong"
            )
    if found["events_missed"] > 0:
        out.append(f"event_driven has no event at {found['events_missed']:g} of the exact_events")
    return out


def _exact(case):
    """The exact solution: shape, start, gaps, signs."""
    from nsbench.reference import listed_contacts

    x = np.asarray(case.exact(case.t))
    out = []
    if x.shape != (len(case.t), case.n):
        return [f"exact(t) returns the shape {x.shape}; {(len(case.t), case.n)} is needed"]
    if np.abs(x[0] - case.x0).max() > 1e-12 and case.start != "project":
        out.append(f"exact(t0) is {x[0]}, x0 is {case.x0}")
    if isinstance(case.problem, Complementarity) and case.problem.constraints:
        from nsbench.dynamics.contacts.constraint_set import ConstraintSet

        scene = ConstraintSet(case.problem, case.n)
        worst = min(
            scene.gaps(t, y, scene.near(y, 0.1, t)).min(initial=0.0)
            for t, y in zip(case.t, x, strict=True)
        )
        if worst < -1e-9 and case.start == "error":
            out.append(f"the exact solution violates a constraint by {-worst:.3g}")
    if case.exact_impulse is not None:
        impulse = np.asarray(case.exact_impulse(case.t))
        m = len(case.contacts if case.contacts is not None else listed_contacts(case))
        if impulse.shape != (len(case.t), m):
            out.append(
                f"exact_impulse(t) returns the shape {impulse.shape}; {(len(case.t), m)} is needed"
            )
        elif np.diff(impulse, axis=0).min(initial=0.0) < -1e-9:
            out.append("an exact impulse decreases: multipliers are not negative")
    return out


def check_solver(path: Path, say) -> list[str]:
    """Protocol, refusals as sentences, and a run of the probes with what it claims for the
    state."""
    name = Path(path).stem
    if name not in solvers.all_names():
        name = solvers.load(path)
    method = solvers.get(name)
    out = []
    for attr in ("accuracy", "default", "claims", "refuses", "prepare"):
        if not hasattr(method, attr):
            out.append(f"SOLVER has no {attr}")
    if out:
        return out
    for probe in PROBES:
        case = get_case(probe)
        why = method.refuses(case)
        say(f"{probe}: {why or 'runs'}")
        if why is not None:
            if not (isinstance(why, str) and len(why.split()) > 2):
                out.append(f"refuses({probe}) returns {why!r}; a sentence or None is needed")
            continue
        traj = solvers.solve(case, name)
        if traj.status.ok and (
            traj.x.shape != (len(case.t), case.n) or not np.all(np.isfinite(traj.x))
        ):
            out.append(f"{probe}: status ok, but x has the shape {traj.x.shape} or is not finite")
        if traj.status.ok and traj.impulse.shape != (len(case.t), len(traj.contacts)):
            out.append(
                f"{probe}: impulse has the shape {traj.impulse.shape} for {len(traj.contacts)} "
                f"contacts"
            )
        if (
            traj.status.ok
            and method.accuracy == "h"
            and method.claims.state
            and case.exact is not None
        ):
            out += _order(case, method, name)
    return out


def _order(case, method, name):
    from nsbench.measure import errors, fit_order

    spacing = float(np.diff(case.t).min())
    hs = []
    es = []
    for n in (2, 3, 5, 7, 11, 17, 27, 41, 64, 101, 160):
        traj = solvers.solve(case, name, h=spacing / n)
        hs.append(traj.stats.get("h", spacing / n))
        es.append(errors(case, traj)["state_sup"])
    fit = fit_order(np.array(hs), np.array(es))
    near = min(abs(slope - method.claims.state) for slope in (fit.order, fit.line))
    if (
        fit.verdict == "exact: no order"
        or near < 0.15
        or (fit.interval[0] <= method.claims.state <= fit.interval[1] <= fit.interval[0] + 1.0)
    ):
        return []
    return [
        f"{case.key}: claims order {method.claims.state:g} in the state, shows {fit.order:.2f} "
        f"({fit.verdict})"
    ]
