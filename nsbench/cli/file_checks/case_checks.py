"""Checks of a case: start, functions in all array namespaces, exact solution, suites.

The exact solution is held against constraints, signs and the event-driven method, which does not
use it; functions of the case are evaluated at the start and at random feasible points.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nsbench import solvers
from nsbench.case import Case
from nsbench.cli.file_checks import namespace_checks
from nsbench.problem import Complementarity
from nsbench.trajectory import Trajectory

Say = Callable[[str], None]
FEASIBILITY = 1e-9  # violation of a constraint, or decrease of an impulse, that is rounding
START_TOLERANCE = 1e-12  # between exact(t0) and x0


def check_repeatable(case: Case, again: Case) -> list[str]:
    """Check that the file builds the same case when it is loaded again."""
    for name in ("x0", "t"):
        if not np.array_equal(getattr(case, name), getattr(again, name)):
            return [
                f"{name} differs when the file is loaded again: draw random numbers with "
                f"np.random.default_rng(seed)"
            ]
    return []


@np.errstate(all="ignore")  # what is not finite becomes a sentence
def check_case(case: Case, say: Say) -> list[str]:
    """Check start, drift, exact solution, and that a standard method accepts the case.

    Returns the violations as sentences.
    """
    violations = []
    if not case.doc:
        violations.append("the file has no docstring: state the equations")
    violations += namespace_checks.check_functions(case)
    violations += [] if violations else _check_start(case)
    # functions that are not finite or give two values may keep a run busy for ever
    traj = None if violations else _run_event_driven(case, say)
    if case.exact is not None:
        violations += _check_exact(case) or _compare_with_event_driven(case, traj)
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


def _run_event_driven(case: Case, say: Say) -> Trajectory | None:
    """Run the event-driven method and say if it is compiled and proven; None if it refuses."""
    if solvers.get("event_driven").refuses(case):
        return None
    traj = solvers.solve(case, "event_driven")
    loop = {"compiled": "compiled", "host": "in Python, which is slower"}
    roots = {
        "verified": "every step is proven to hide no event",
        "sampled": "not proven: some steps are only sampled for events",
    }
    note = traj.stats.get("note", "")  # it says why it is in Python, and what is not proven
    words = (
        "" if note else loop.get(traj.stats.get("loop"), ""),
        note.removesuffix("."),
        "" if note and traj.stats.get("unproven") else roots.get(traj.stats.get("roots"), ""),
        "" if traj.status.ok else str(traj.status),
    )
    say(f"{case.key}: event_driven: {'; '.join(filter(None, words))}")
    return traj


def _compare_with_event_driven(case: Case, traj: Trajectory | None) -> list[str]:
    """Compare exact solution, impulse and events with the event-driven method, which knows none."""
    from nsbench.measure import errors

    # events that accumulate and branching motions are properties of the case: they have been said
    if traj is None or traj.status.code in ("chatter", "degenerate"):
        return []
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
