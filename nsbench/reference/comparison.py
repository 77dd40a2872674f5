"""Distance of two references of one solution; error bounds of a closed form from a certificate."""

from __future__ import annotations

import dataclasses

import numpy as np

from nsbench.case import Case
from nsbench.reference.reference import Reference, columns_of, spread

FORMULA = 256 * float(
    np.finfo(float).eps
)  # relative; closed forms are some dozen operations on rounded times


def bounded_by(case: Case, closed: Reference, proof: Reference) -> Reference:
    """Give a closed form the bounds that a certificate of the same case proves.

    The allowance is what rounding may do to formulas of a dozen operations on rounded times. Raises
    ValueError if the two disagree.
    """
    state = float(np.abs(closed.x - proof.x).max())
    reaction = 0.0
    impulse = 0.0
    selected = bool(
        proof.shown.get("shut")
    )  # multipliers that are not unique: each may choose its own
    if closed.impulse is not None and not selected:
        state, reaction, impulse, _ = differences(case, closed, proof)
    scale = max(1.0, float(np.abs(closed.x).max()), float(np.abs(proof.impulse).max(initial=0.0)))
    quadrature = closed.reaction_error if closed.reaction is not None else 0.0
    for name, off, more in (
        ("exact(t)", state, 0.0),
        ("exact_impulse(t)", impulse, 0.0),
        ("the reaction that follows", reaction, quadrature),
    ):
        if off > FORMULA * scale + more:
            raise ValueError(
                f"{case.key}: the closed form and its certificate differ by {off:.2e} in {name}"
            )
    at = np.array([e.t for e in proof.events or ()])
    for e in closed.events or ():
        late = np.abs(at - e.t).min(initial=np.inf)
        if late > FORMULA * max(1.0, float(np.abs(case.t).max())):
            raise ValueError(
                f"{case.key}: exact_events has t = {e.t:.12g}; the certificate's nearest event is "
                f"{late:.1e} off"
            )
    changes = {
        "state_error": state + proof.state_error,
        "how": f"{closed.how + '; ' if closed.how else ''}a certificate differs by {state:.1e}",
    }
    if closed.impulse is not None and not selected:
        changes["impulse_error"] = impulse + proof.impulse_error
    if closed.reaction is not None and proof.reaction is not None:
        changes["reaction_error"] = (
            float(np.abs(closed.reaction - proof.reaction).max(initial=0.0)) + proof.reaction_error
        )
    if closed.events is None:
        changes |= {"events": proof.events, "event_error": proof.event_error}
    return dataclasses.replace(closed, **changes)


def differences(case: Case, a: Reference, b: Reference) -> tuple[float, float, float, float]:
    """Compute the largest differences of two solutions in state, reaction, impulse and event times.

    The reaction's is 0 for a Filippov system; the event times' is NaN if the two do not have the
    same events in the same order.
    """
    state = float(np.abs(a.x - b.x).max())
    reaction = 0.0
    if a.reaction is not None and b.reaction is not None and a.reaction.size:
        reaction = float(np.abs(a.reaction - b.reaction).max())
    columns = columns_of(case.problem, a.contacts, b.contacts)
    da, db = (spread(case.problem, r.contacts, r.impulse, columns) for r in (a, b))
    times = float("nan")
    if a.events is not None and [(e.kind, e.contact) for e in a.events] == [
        (e.kind, e.contact) for e in b.events
    ]:
        times = max((abs(e.t - f.t) for e, f in zip(a.events, b.events, strict=True)), default=0.0)
    return state, reaction, float(np.abs(da - db).max(initial=0.0)), times
