"""Certified references of small scenes: the arcs of an event-driven run, proven in 30 digits.

An independent computation (Taylor series with high-precision coefficients, events by Newton,
multipliers by series division) follows the arcs; balls then bound its distance from the solution
and show that on every arc the gaps, the multipliers and the sliding weights keep their signs. The
solution through a state is unique, so this proves that the path is the solution. Needs python-flint
(the extra "certify"); what is stored needs nothing.
"""

from __future__ import annotations

import importlib.util
import math
import platform
from dataclasses import dataclass
from importlib import metadata

import numpy as np

from nsbench.case import Case
from nsbench.problem import LCS, Complementarity, Hybrid
from nsbench.reference.reference import EPS, Reference
from nsbench.trajectory import Event

# largest state and number of constraints: the work grows with their cubes and squares
STATES = 60
LISTED = 600
EVENTS = 200
# on series, of a path whose proof is tried and not asked for: minutes
OPERATIONS = 1.5e6
SHOWN = 30  # digits of event times
AGREE = 1e-9  # the run that gave the arcs must be this close to what came out of them


@dataclass(frozen=True, eq=False)
class Certificate:
    """Hold a proven reference.

    reference: rounded to double, its bounds including the rounding; times, final: 30 digits;
    proven: bounds without rounding; notes: what was taken without proof; arcs, steps: how many;
    seconds are the caller's.
    """

    reference: Reference
    proven: dict
    notes: tuple
    arcs: int
    steps: int


def available() -> bool:
    return importlib.util.find_spec("flint") is not None


def why_not(case: Case) -> str | None:
    """Return why no certificate can be made for the case; None if it can be tried."""
    if not available():
        return "python-flint is not installed (`pip install python-flint` lets one be made)"
    if not case.unique:
        return f"{case.key} has no unique solution"
    if isinstance(case.problem, (LCS, Hybrid)):
        return f"{case.problem.kind}s have no certificates"
    if case.n > STATES:
        return f"{case.n} states; at most {STATES} are certified"
    if isinstance(case.problem, Complementarity):
        from nsbench.dynamics.contacts.constraint_set import ConstraintSet

        scene = ConstraintSet(case.problem, case.n)
        count = len(scene.all_static()) + sum(m * (m - 1) // 2 for _, _, m in scene.hard)
        if count > LISTED:
            return f"{count} constraints; at most {LISTED} are certified"
        if case.problem.constraints and case.start == "keep":
            return "the start is kept although it is not feasible"
    return None


def certify(
    case: Case,
    arcs=None,
    order: int = 40,
    digits: float = 36.0,
    bits: int = 200,
    operations: float = math.inf,
) -> Certificate:
    """Follow and prove the arcs (by default those of event_driven).

    order: of the Taylor series; digits: truncation of a step; bits: working precision; operations:
    most on series that the path may take, a quarter of those of its bounds. Raises
    Refused (a ValueError) with the place and the reason if they are not the solution or that cannot
    be shown.
    """
    why = why_not(case)
    if why:
        raise ValueError(why)
    from nsbench.reference.certify.claimed_arcs import arcs_of
    from nsbench.reference.certify.error_bound import enclose
    from nsbench.reference.certify.high_precision_path import Digits, follow
    from nsbench.solvers.common.initial_state import initial_state

    arcs = arcs_of(case) if arcs is None else arcs
    if len(arcs) > EVENTS:
        raise ValueError(f"{len(arcs) - 1} events; at most {EVENTS} are certified")
    start = case.x0
    if isinstance(case.problem, Complementarity):
        from nsbench.dynamics.contacts.constraint_set import ConstraintSet

        start = initial_state(case, ConstraintSet(case.problem, case.n))
    work = Digits(order, digits, bits, operations)
    path = follow(case, arcs, work, start)
    bounds = enclose(path, work)
    return Certificate(
        _rounded(case, arcs, path, bounds, work),
        {
            "state": bounds.state,
            "impulse": bounds.impulse,
            "reaction": bounds.reaction,
            "time": max(bounds.times, default=0.0),
        },
        bounds.notes,
        len(arcs),
        sum(len(p.steps) for p in path.pieces),
    )


def _rounded(case: Case, arcs, path, bounds, work) -> Reference:
    """Round a proven path to double; its bounds include the rounding."""
    from nsbench.reference.certify.high_precision_path import doubles, event_times

    x = doubles(path.x)
    impulse = doubles(path.impulse).reshape(len(case.t), len(path.contacts))
    reaction = doubles(path.reaction).reshape(len(case.t), -1)
    times = event_times(path)
    events = tuple(
        Event(float(t), kind, contact)
        for arc, t in zip(arcs[:-1], times, strict=True)
        for kind, contact in arc.events
    )
    contact = isinstance(case.problem, Complementarity)
    shown = {
        "times": [t.str(SHOWN, radius=False) for t in times],
        "final": [v.str(SHOWN, radius=False) for v in path.x[-1]],
    }
    shut = sorted({c for p in path.pieces for c in p.flow.shut})
    if shut:  # closed without a multiplier of their own: others may share it
        shown["shut"] = [list(c) for c in shut]
    event_error = max(bounds.times, default=0.0)
    return Reference(
        case.t,
        x,
        path.contacts,
        impulse,
        reaction if contact else None,
        events,
        bounds.state + path.moved + rounding(x),
        bounds.impulse + rounding(impulse),
        bounds.reaction + rounding(reaction) if contact else float("nan"),
        "certified",
        _origin(case, arcs, path, bounds, work),
        versions(),
        event_error + rounding(case.t),
        shown,
    )


def _origin(case, arcs, path, bounds, work) -> str:
    """Say how a certificate was made and what was taken without proof."""
    how = (
        f"Taylor series of order {work.order} in {work.bits} bits along {len(arcs)} arcs of "
        f"event_driven, signs proven by balls; "
        f"before rounding the state is known to {bounds.state:.0e}, event times to "
        f"{max(bounds.times, default=0.0):.0e}"
    )
    if path.moved:
        how += f"; the start was put on its constraints, {path.moved:.0e} away"
    if case.start == "project":
        how += "; that the start is the nearest feasible point is computed in doubles, not proven"
    return how + "".join(f"; {n}" for n in bounds.notes)


def rounding(values) -> float:
    """Bound the rounding of values to double: half a unit in the last place of the largest one."""
    return 0.5 * EPS * max(1.0, float(np.abs(values).max(initial=0.0)))


def versions() -> dict:
    return {"python": platform.python_version()} | {
        p: metadata.version(p) for p in ("nsbench", "numpy", "scipy", "python-flint")
    }
