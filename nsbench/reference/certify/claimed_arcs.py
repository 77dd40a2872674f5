"""Arcs that an event-driven run claims: active contacts or mode of each, and the event at its end.

Only the public trajectory is read. The case is run once more with samples inside every arc, and
what acts there is what has an impulse there. Nothing of it is believed: the certificate proves or
refuses it.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from nsbench import solvers
from nsbench.case import Case
from nsbench.compilation.factories import as_numpy
from nsbench.problem import Complementarity, Filippov
from nsbench.reference.reference import canonical

TOGETHER = 1e-9  # events this close are taken for one instant; the certificate finds out
CLOSED = 1e-9  # gap of a contact that is closed, relative to 1 + |x|
ACTS = 1e-10  # multiplier that acts, relative to the largest of the arc


@dataclass(frozen=True)
class Arc:
    """Describe one arc: from the end of the last one to time `end`, where the `triggers` (what,
    contact) reach zero.

    held: contacts with a multiplier; shut: closed ones without; mode: signs of the surfaces
    (Filippov); events: (kind, contact) of all that the run reports for that instant.
    """

    end: float
    triggers: tuple
    held: tuple = ()
    shut: tuple = ()
    mode: tuple = ()
    events: tuple = ()


def arcs_of(case: Case, spec: str = "event_driven", tol: float = 1e-13) -> list[Arc]:
    """Read off the arcs of a run; raise ValueError if it does not end well."""
    first = _run(case, spec, tol)
    times = instants(case, first.events)
    cuts = np.concatenate(([case.t[0]], [t for t, _ in times], [case.t[-1]]))
    inner = np.concatenate([a + (b - a) * np.array([0.3, 0.5, 0.7]) for a, b in pairwise(cuts)])
    fine = case.replace(
        t=np.unique(np.concatenate((case.t[[0, -1]], inner))),
        exact=None,
        exact_impulse=None,
        exact_events=None,
    )
    traj = _run(fine, spec, tol)
    out = []
    for k in range(len(cuts) - 1):
        at = np.searchsorted(traj.t, inner[3 * k : 3 * k + 3])
        events = times[k][1] if k < len(times) else ()
        arc = _arc(case, traj, at, float(cuts[k + 1]), events)
        out.append(dataclasses.replace(arc, events=tuple((e.kind, e.contact) for e in events)))
    for k, after in enumerate(out[1:]):
        if after.mode:
            out[k] = dataclasses.replace(out[k], triggers=_switches(out[k], after))
    return out


def _switches(arc: Arc, after: Arc) -> tuple:
    """List what vanishes where a mode changes to the next: the margin of a sign on the side it
    leaves to, or the switch itself.
    """
    out = []
    for _, contact in arc.events:
        old = arc.mode[contact[1]]
        new = after.mode[contact[1]]
        if old != new:
            out.append(
                ("upper" if new > 0 else "lower", contact) if old == 0 else ("side", contact)
            )
    return _causes(out, "side")


def _causes(triggers, kind) -> tuple:
    """Keep the triggers that cause an event: where a surface or contact is reached, what releases
    at the same instant may do so by a jump.
    """
    met = [t for t in triggers if t[0] == kind]
    return tuple(dict.fromkeys(met or triggers))


def _run(case, spec, tol):
    traj = solvers.solve(case, spec, tol=tol)
    if not traj.status.ok:
        raise ValueError(f"{case.key}: {spec} ended with {traj.status.code}: {traj.status}")
    return traj


def instants(case: Case, events) -> list:
    """Group the events that fall together: (time, events), inside the run."""
    out = []
    for e in sorted(events, key=lambda e: e.t):
        if out and e.t - out[-1][0] < TOGETHER:
            out[-1][1].append(e)
        elif e.t > case.t[-1] - TOGETHER:
            raise ValueError(
                f"an event at t = {e.t:.12g} falls on the last sample: what happens there is not "
                f"decided"
            )
        elif e.t > case.t[0] + TOGETHER:
            out.append((e.t, [e]))
    return out


def _arc(case, traj, at, end, events) -> Arc:
    """Describe the arc about the time `at` from the samples of the run."""
    t = traj.t[at]
    x = traj.x[at]
    mean = (traj.impulse[at[1:]] - traj.impulse[at[:-1]]) / np.diff(t)[:, None]
    if isinstance(case.problem, Complementarity):
        return _contacts(case, traj, t, x, mean, end, events)
    if isinstance(case.problem, Filippov):
        c = np.array([as_numpy(case.problem.switch)(s, y) for s, y in zip(t, x, strict=True)])
        slides = np.all(np.abs(c) <= CLOSED * (1.0 + np.abs(x).max()), axis=0)
        mode = tuple(0 if s else int(np.sign(v)) for s, v in zip(slides, c[1], strict=True))
        return Arc(end, (), mode=mode)
    raise ValueError(f"certificates know no {type(case.problem).__name__} systems")


def _contacts(case, traj, t, x, mean, end, events):
    """Split the closed contacts of an arc into those with a multiplier and those without; find its
    triggers.
    """
    from nsbench.dynamics.contacts.constraint_set import ConstraintSet

    scene = ConstraintSet(case.problem, case.n)
    big = CLOSED * (1.0 + np.abs(x).max())
    closed = None
    for s, y in zip(t, x, strict=True):
        near = scene.near(y, 10 * big, s)
        shut = {c for c, g in zip(near.ids, scene.gaps(s, y, near), strict=True) if g <= big}
        closed = shut if closed is None else closed & shut
    acts = mean.max(axis=0, initial=0.0) if mean.size else np.zeros(len(traj.contacts))
    limit = ACTS * max(1.0, float(acts.max(initial=0.0)))
    names = [canonical(case.problem, c) for c in traj.contacts]
    held = tuple(c for c, v in zip(names, acts, strict=True) if v > limit and c in closed)
    triggers = []
    for e in events:
        c = canonical(case.problem, e.contact)
        if e.kind == "contact" and c not in closed:
            triggers.append(("gap", c))
        elif e.kind in ("release", "pivot") and c in held:
            triggers.append(("lam", c))
    return Arc(end, _causes(triggers, "gap"), held, tuple(sorted(closed - set(held))))
