"""The stored truths of the systems in cases/, and how far a trajectory is from one.

truths.npz holds states, cumulative impulses and reactions at the sample times (float64),
truths.json the event times (20 digits), the names of the contacts and what of all this is unique.
recompute.py makes them anew.
"""

from __future__ import annotations

import json
from collections import defaultdict
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

import nsbench

HERE = Path(__file__).parent
# events further apart than this, of the unit of time, are not the same event told inexactly
NEAR = 1e-5
# times closer than this are one time, where only times are unique or an event is optional
SAME = 1e-12


@dataclass(frozen=True)
class Truth:
    """States (k, n), impulses (k, m) of the contacts `ids`, events (time, kind, id).

    unique: "all", "times" or "none" of the events; weights (w, m): the unique combinations of
    impulses, None for each of them; optional: times at which an event may be told or not; reaction
    (k, n) where impulses are not unique, else None.
    """

    x: np.ndarray
    impulse: np.ndarray
    reaction: np.ndarray | None
    ids: tuple
    events: tuple
    unique: str
    weights: np.ndarray | None
    optional: tuple


@dataclass(frozen=True)
class Errors:
    """Largest errors of states, impulses and event times, each relative to max(unit, size); what
    was missed or is extra.

    The unit is 1, or the largest state or impulse (of times: the end) if that is less: micrometres
    are not compared to 1.
    It is one for states and impulses, for an impulse is what two states of their size differ by.
    """

    state: float
    impulse: float
    event: float
    missed: tuple
    extra: tuple


@cache
def stored():
    with np.load(HERE / "truths.npz") as data:
        return json.loads((HERE / "truths.json").read_text(encoding="utf-8")), dict(data)


def names() -> list[str]:
    return sorted(stored()[0])


def truth(name: str) -> Truth:
    rest, data = stored()
    d = rest[name]
    return Truth(
        data[f"{name}.x"],
        data[f"{name}.impulse"],
        data.get(f"{name}.reaction"),
        tuple(map(tuple, d["ids"])),
        tuple((t, kind, tuple(c)) for t, kind, c in d["events"]),
        d["unique"],
        None if d["weights"] is None else np.array(d["weights"], float).reshape(-1, len(d["ids"])),
        tuple(d["optional"]),
    )


def case(name: str) -> nsbench.Case:
    """The system, by the public way: as a case file."""
    return nsbench.load_case(HERE / "cases" / f"{name}.py")


def unit(*arrays) -> float:
    """1, or the largest size in the arrays if that is less and not 0."""
    return min(1.0, max(float(np.max(np.abs(a), initial=0.0)) for a in arrays) or 1.0)


def distance(a, b, one) -> float:
    """Largest |a - b| / max(one, |b|); infinite where a is not finite."""
    e = np.abs(a - b) / np.maximum(one, np.abs(b))
    return float(np.max(np.where(np.isfinite(e), e, np.inf), initial=0.0))


def grouped(events, unique):
    """Sorted event times by (kind, contact), or all distinct ones where only times are unique."""
    out = defaultdict(list)
    for t, kind, c in sorted(events):
        key = (kind, c) if unique == "all" else "any"
        if unique == "all" or not out[key] or t - out[key][-1] > SAME:
            out[key].append(t)
    return out


def paired(told, true, optional, near):
    """(error, missed, extra) of two sorted lists of times, each used once, paired if not further
    apart than `near`."""
    worst = 0.0
    missed = []
    rest = list(told)
    for t in true:
        s = min(rest, key=lambda s: abs(s - t), default=np.inf)
        if abs(s - t) > near:
            missed.append(t)
            continue
        rest.remove(s)
        worst = max(worst, abs(s - t))
    extra = [s for s in rest if min((abs(s - o) for o in optional), default=np.inf) > SAME]
    return worst, missed, extra


def compare(traj, true: Truth) -> Errors:
    """Errors of a trajectory; a contact that acts and that the truth does not know counts into the
    impulse."""
    one = unit(true.x, true.impulse)
    told = {tuple(map(int, c)): traj.impulse[:, k] for k, c in enumerate(traj.contacts)}
    zero = np.zeros(len(true.x))
    columns = np.stack([told.get(c, zero) for c in true.ids], axis=1)
    w = np.eye(len(true.ids)) if true.weights is None else true.weights
    impulse = [distance(columns @ w.T, true.impulse @ w.T, one)]
    impulse += [distance(v, zero, one) for c, v in told.items() if c not in true.ids]
    if true.reaction is not None:
        impulse.append(distance(traj.reaction, true.reaction, one))
    worst = 0.0
    missed = []
    extra = []
    if true.unique != "none":
        a = grouped(
            [(float(e.t), e.kind, tuple(map(int, e.contact))) for e in traj.events], true.unique
        )
        b = grouped([(float(t), kind, c) for t, kind, c in true.events], true.unique)
        for key in a.keys() | b.keys():
            error, lost, more = paired(a[key], b[key], true.optional, NEAR * unit(traj.t[-1:]))
            worst = max(worst, error / unit(traj.t[-1:]))
            missed = missed + lost
            extra = extra + more
    return Errors(
        distance(traj.x, true.x, one),
        max(impulse),
        worst,
        tuple(sorted(missed)),
        tuple(sorted(extra)),
    )
