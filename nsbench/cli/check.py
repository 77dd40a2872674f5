"""`nsbench check`: does a case file or a solver file keep the contract?

Each violation is a sentence. A case is checked for its start, its drift in all array namespaces,
and its exact solution against constraints, signs and the event-driven method, which does not use
it. A solver is checked for the protocol, its refusals, and the order that it claims on three small
cases.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np

from nsbench import solvers
from nsbench.case import Case, get_case, load_case, load_module
from nsbench.cli.exit_codes import FAILED, FINE
from nsbench.compilation.factories import as_numpy
from nsbench.input_errors import describe
from nsbench.problem import LCS, Complementarity, Filippov

Say = Callable[[str], None]
PROBES = ("tide", "sliding", "three_discs")  # one of each kind of problem that solvers accept
DRIFT_RTOL = 1e-13  # of a drift in two namespaces: some roundings
SUBSTEPS = (2, 3, 5, 7, 11, 17, 27, 41, 64, 101, 160)  # steps between two samples, not dyadic
ORDER_TOLERANCE = 0.15  # between the claimed order and a fitted one
WIDEST_INTERVAL = 1.0  # of a fitted order: a wider one holds any claim
FEASIBILITY = 1e-9  # violation of a constraint, or decrease of an impulse, that is rounding
START_TOLERANCE = 1e-12  # between exact(t0) and x0


def command(args: argparse.Namespace, say: Callable[[str], None]) -> int:
    """Check a file and print each violation; 3 if there are any."""
    violations = check_file(Path(args.file), say)
    for sentence in violations:
        say(f"  not met: {sentence}")
    count = f"{len(violations)} point{'s' * (len(violations) > 1)} to correct"
    say(f"{args.file}: {count if violations else 'fine'}")
    return FAILED if violations else FINE


def check_file(path: Path, say: Say) -> list[str]:
    """Check a case file or a solver file; returns the violations as sentences.

    Whatever the file raises is a violation too, but for FileNotFoundError and KeyboardInterrupt.
    `say` describes what was checked.
    """
    try:
        return _check_module(path, say)
    except (FileNotFoundError, KeyboardInterrupt):
        raise
    except (Exception, SystemExit) as e:
        return [str(e) if isinstance(e, (LookupError, ValueError)) else describe(e, path.resolve())]


def _check_module(path: Path, say: Say) -> list[str]:
    module = load_module(path)
    if hasattr(module, "SOLVER"):
        return check_solver(path, say)
    if hasattr(module, "CASE") or hasattr(module, "make"):
        return check_case(load_case(path), say)
    return [f"{path} defines none of CASE, make, SOLVER"]


def check_case(case: Case, say: Say) -> list[str]:
    """Check start, drift, exact solution, and that a standard method accepts the case.

    Returns the violations as sentences.
    """
    violations = []
    if not case.doc:
        violations.append("the file has no docstring: state the equations")
    violations += _check_start(case)
    violations += _check_namespaces(case)
    if case.exact is not None:
        violations += _check_exact(case) or _compare_with_event_driven(case)
    accepting = [s for s in solvers.standard() if solvers.get(s).refuses(case) is None]
    if not accepting:
        violations.append("every method of the standard suite refuses it")
    say(
        f"{case.key}: n = {case.n}, {len(case.t)} samples, exact solution: "
        f"{'yes' if case.exact else 'no'}, methods: {', '.join(accepting)}"
    )
    return violations


def _check_start(case: Case) -> list[str]:
    """Check that the start satisfies the constraints, as far as the case wants it to."""
    from nsbench.dynamics.contacts.constraint_set import ConstraintSet
    from nsbench.solvers.common.initial_state import initial_state

    if not isinstance(case.problem, Complementarity):
        return []
    try:
        initial_state(case, ConstraintSet(case.problem, case.n))
    except ValueError as e:
        return [str(e)]
    return []


def _check_namespaces(case: Case) -> list[str]:
    """Compare the drift in numba and in JAX with numpy at the start."""
    if isinstance(case.problem, LCS):
        return []
    t = float(case.t[0])
    x = np.array(case.x0)
    if isinstance(case.problem, Filippov):
        factory = case.problem.field
        arguments = (t, x, np.ones(len(np.asarray(as_numpy(case.problem.switch)(t, x)))))
    else:
        factory = case.problem.drift
        arguments = (t, x)
    expected = as_numpy(factory)(*arguments)
    return [
        *_check_numba(factory, arguments, expected),
        *_check_jax(factory, arguments, expected),
    ]


def _check_numba(factory, arguments: tuple, expected: np.ndarray) -> list[str]:
    import numba

    from nsbench.compilation import factories

    n = len(arguments[1])
    try:
        if len(arguments) == 2:
            pointer = factories.rhs_cfunc(factory, n)
        else:
            pointer = factories.signed_rhs_cfunc(factory, n, len(arguments[2]))
        value = np.empty(n)
        numba.njit(lambda f, *a: f(*a))(pointer, *arguments, value)
    except factories.CompileError as e:
        return [f"numba cannot compile the drift, runs will be slow: {e}"]
    if np.allclose(value, expected, rtol=DRIFT_RTOL, atol=DRIFT_RTOL, equal_nan=True):
        return []
    difference = np.abs(value - expected).max()
    return [f"the drift compiled by numba differs from numpy by {difference:.3g}"]


def _check_jax(factory, arguments: tuple, expected: np.ndarray) -> list[str]:
    from nsbench.compilation import factories

    try:
        value = np.asarray(factories.as_jax(factory)(*arguments))
        if np.allclose(value, expected, rtol=DRIFT_RTOL, atol=DRIFT_RTOL, equal_nan=True):
            return []
        difference = np.abs(value - expected).max()
        return [f"the drift in JAX differs from numpy by {difference:.3g}"]
    except Exception as e:  # whatever JAX raises on a drift that is not written for it
        return [
            f"JAX cannot run the drift, so penalty cannot: {type(e).__name__}: "
            f"{str(e).splitlines()[0]}"
        ]


def _compare_with_event_driven(case: Case) -> list[str]:
    """Compare exact solution, impulse and events with the event-driven method, which knows none."""
    from nsbench.measure import errors

    method = solvers.get("event_driven")
    if method.refuses(case):
        return []
    traj = solvers.solve(case, "event_driven")
    if not traj.status.ok:
        return [f"event_driven cannot confirm the exact solution: {traj.status}"]
    try:
        found = errors(case, traj)
    except ValueError as e:  # a certificate of this case contradicts it
        return [str(e)]
    violations = []
    for error, what, limit, scale in (
        (found["state_sup"], "exact(t)", 1e-8, found["state_scale"]),
        (found["impulse"], "exact_impulse(t)", 1e-7, found["impulse_scale"]),
        (found["event_time"], "exact_events", 1e-7, 1.0),
    ):
        if error > limit * scale:
            violations.append(
                f"event_driven differs from {what} by {error:.3g}; one of the two is wrong"
            )
    if found["events_missed"] > 0:
        violations.append(
            f"event_driven has no event at {found['events_missed']:g} of the exact_events"
        )
    return violations


def _check_exact(case: Case) -> list[str]:
    """Check shape, start, gaps and signs of the exact solution."""
    x = np.asarray(case.exact(case.t))
    if x.shape != (len(case.t), case.n):
        return [f"exact(t) returns the shape {x.shape}; {(len(case.t), case.n)} is needed"]
    violations = []
    if np.abs(x[0] - case.x0).max() > START_TOLERANCE and case.start != "project":
        violations.append(f"exact(t0) is {x[0]}, x0 is {case.x0}")
    if isinstance(case.problem, Complementarity) and case.problem.constraints:
        from nsbench.dynamics.contacts.constraint_set import ConstraintSet

        scene = ConstraintSet(case.problem, case.n)
        smallest_gap = min(
            scene.gaps(t, y, scene.near(y, 0.1, t)).min(initial=0.0)
            for t, y in zip(case.t, x, strict=True)
        )
        if smallest_gap < -FEASIBILITY and case.start == "error":
            violations.append(f"the exact solution violates a constraint by {-smallest_gap:.3g}")
    if case.exact_impulse is not None:
        violations += _check_exact_impulse(case)
    return violations


def _check_exact_impulse(case: Case) -> list[str]:
    from nsbench.reference import listed_contacts

    impulse = np.asarray(case.exact_impulse(case.t))
    contacts = case.contacts if case.contacts is not None else listed_contacts(case)
    shape = (len(case.t), len(contacts))
    if impulse.shape != shape:
        return [f"exact_impulse(t) returns the shape {impulse.shape}; {shape} is needed"]
    if np.diff(impulse, axis=0).min(initial=0.0) < -FEASIBILITY:
        return ["an exact impulse decreases: multipliers are not negative"]
    return []


def check_solver(path: Path, say: Say) -> list[str]:
    """Check the protocol, the refusals, and runs of the probe cases with the order claimed.

    Returns the violations as sentences.
    """
    name = Path(path).stem
    if name not in solvers.all_names():
        name = solvers.load(path)
    method = solvers.get(name)
    needed = ("accuracy", "default", "claims", "refuses", "prepare")
    violations = [f"SOLVER has no {attr}" for attr in needed if not hasattr(method, attr)]
    if violations:
        return violations
    for probe in PROBES:
        case = get_case(probe)
        why = method.refuses(case)
        say(f"{probe}: {why or 'runs'}")
        if why is None:
            violations += _check_run(case, method, name)
        elif not (isinstance(why, str) and len(why.split()) > 2):
            violations.append(f"refuses({probe}) returns {why!r}; a sentence or None is needed")
    return violations


def _check_run(case: Case, method, name: str) -> list[str]:
    """Check shapes and finiteness of one run, and the order where there is an exact solution."""
    traj = solvers.solve(case, name)
    if not traj.status.ok:
        return []
    violations = []
    if traj.x.shape != (len(case.t), case.n) or not np.all(np.isfinite(traj.x)):
        violations.append(
            f"{case.key}: status ok, but x has the shape {traj.x.shape} or is not finite"
        )
    if traj.impulse.shape != (len(case.t), len(traj.contacts)):
        violations.append(
            f"{case.key}: impulse has the shape {traj.impulse.shape} for {len(traj.contacts)} "
            f"contacts"
        )
    if method.accuracy == "h" and method.claims.state and case.exact is not None:
        violations += _check_order(case, method, name)
    return violations


def _check_order(case: Case, method, name: str) -> list[str]:
    """Fit the order of the state error over eleven steps and compare it with the claim."""
    from nsbench.measure import errors, fit_order

    spacing = float(np.diff(case.t).min())
    steps = []
    state_errors = []
    for n in SUBSTEPS:
        traj = solvers.solve(case, name, h=spacing / n)
        steps.append(traj.stats.get("h", spacing / n))
        state_errors.append(errors(case, traj)["state_sup"])
    fit = fit_order(np.array(steps), np.array(state_errors))
    claim = method.claims.state
    low, high = fit.interval
    if (
        fit.verdict == "exact: no order"
        or min(abs(order - claim) for order in (fit.order, fit.line)) < ORDER_TOLERANCE
        or low <= claim <= high <= low + WIDEST_INTERVAL
    ):
        return []
    return [
        f"{case.key}: claims order {claim:g} in the state, shows {fit.order:.2f} ({fit.verdict})"
    ]
