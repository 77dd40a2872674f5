"""What is known of a solution, and how much of it a closed form gives: states, impulses, events, the reaction."""
from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from nsbench.case import Case
from nsbench.problem import LCS, Complementarity, Distance
from nsbench.trajectory import Event

EPS = float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Reference:
    """What is known of a solution at the sample times.

    t (k,), x (k, n); contacts: ids of the m columns of impulse (k, m), or impulse None where it is not known;
    reaction (k, n) or None (Filippov); events: Event with kind "" where only the time is known, or None (unknown).
    state_error, impulse_error, reaction_error: bounds of its own error (max norm), NaN for what is None.
    kind: "closed form", "stored" (two runs that agree) or "certified" (proven); how: who made it; versions: of the
    libraries that did. event_error: bound of the event times, NaN where there are none to tell; shown: further digits of
    a certified one, {"times": [...], "final": [...]} as decimals.
    """
    t: np.ndarray
    x: np.ndarray
    contacts: tuple
    impulse: np.ndarray | None
    reaction: np.ndarray | None
    events: tuple[Event, ...] | None
    state_error: float
    impulse_error: float = float("nan")
    reaction_error: float = float("nan")
    kind: str = "closed form"
    how: str = ""
    versions: dict = dataclasses.field(default_factory=dict)
    event_error: float = float("nan")
    shown: dict = dataclasses.field(default_factory=dict)

    def __str__(self) -> str:
        known = (("state", self.state_error), ("impulse", self.impulse_error), ("reaction", self.reaction_error),
                 ("event times", self.event_error))
        bounds = ", ".join(f"{name} to {v:.1e}" for name, v in known if not np.isnan(v))
        return f"{self.kind}, {bounds}{'; ' + self.how if self.how else ''}"


def closed_form(case: Case) -> Reference:
    """From case.exact, exact_impulse, exact_events; its own error is the rounding of the formulas."""
    t = case.t
    x = _checked(case, "exact", case.exact(t), (len(t), case.n))
    scale = max(1.0, float(np.abs(x).max(initial=0.0)))
    impulse, ids = None, ()
    if case.exact_impulse is not None:
        ids = tuple(case.contacts) if case.contacts is not None else listed_contacts(case)
        impulse = _checked(case, "exact_impulse", case.exact_impulse(t), (len(t), len(ids)))
    times = case.exact_events
    events = None if times is None else tuple(
        e if isinstance(e, Event) else Event(float(e), "", ()) for e in times)
    f = right_hand_side(case.problem)
    reaction, quadrature = (None, float("nan")) if f is None else _reaction(case, f, x, events or ())
    size = scale if impulse is None else max(scale, float(np.abs(impulse).max(initial=0.0)))
    return Reference(t, x, ids, impulse, reaction, events, 4 * EPS * scale,
                     float("nan") if impulse is None else 4 * EPS * size, quadrature + 4 * EPS * size,
                     event_error=float("nan") if not events else 4 * EPS * max(1.0, float(np.abs(t).max())))


def _checked(case, name, value, shape):
    value = np.asarray(value, float)
    if value.shape != shape or not np.all(np.isfinite(value)):
        raise ValueError(f"{name} of {case.key} returns shape {value.shape}; finite values of shape {shape} are needed")
    return value


def right_hand_side(problem):
    """f(t, x) without the multipliers' part, in numpy; None for a Filippov system."""
    if isinstance(problem, Complementarity):
        return problem.drift(np)
    if isinstance(problem, LCS):
        u = problem.u(np) if problem.u else lambda t: 0.0
        return lambda t, x: problem.A @ x + u(t)
    return None


def listed_contacts(case: Case) -> tuple:
    """Ids of the rows of the families in order, all pairs excepted; of the surfaces of the other classes."""
    p = case.problem
    if isinstance(p, Complementarity):
        from nsbench.contacts import Scene
        return tuple(Scene(p, case.n).all_static().ids)
    if isinstance(p, LCS):
        return tuple((0, i) for i in range(p.B.shape[1]))
    return tuple((0, i) for i in range(len(np.asarray(p.switch(np)(float(case.t[0]), case.x0)))))


def canonical(problem, contact) -> tuple:
    """A contact's id with i < j where both are particles of one family."""
    c = tuple(int(v) for v in contact)
    if len(c) == 3 and c[1] > c[2] and isinstance(problem, Complementarity):
        family = problem.constraints[c[0]]
        if isinstance(family, Distance) and family.anchors is None:
            return c[0], c[2], c[1]
    return c


def spread(problem, contacts, values, columns: dict) -> np.ndarray:
    """`values` (k, m) of `contacts` on the `columns` {id: column}; absent contacts are zero."""
    out = np.zeros((len(values), len(columns)))
    for k, c in enumerate(contacts):
        out[:, columns[canonical(problem, c)]] += values[:, k]
    return out


def columns_of(problem, *lists) -> dict:
    """One column for every contact of the lists of ids."""
    return {c: k for k, c in enumerate(sorted({canonical(problem, c) for ids in lists for c in ids}))}


def _reaction(case, f, x, events):
    """R(t) = x(t) - x(t0) - integral of f(s, x(s)) ds by Gauss rules of 12 and 8 nodes on pieces split at the events:
    (k, n) and the difference of the two rules."""
    cuts = np.array([e.t for e in events if case.t[0] < e.t < case.t[-1]])
    knots = np.unique(np.concatenate((case.t, cuts)))
    sums = []
    for order in (12, 8):
        node, weight = np.polynomial.legendre.leggauss(order)
        half = np.diff(knots) / 2
        s = (knots[:-1] + half)[:, None] + half[:, None] * node
        states = np.asarray(case.exact(s.ravel()), float)
        values = np.array([f(a, b) for a, b in zip(s.ravel(), states, strict=True)]).reshape(*s.shape, case.n)
        pieces = np.einsum("pgn,pg->pn", values, half[:, None] * weight)
        total = np.concatenate((np.zeros((1, case.n)), np.cumsum(pieces, axis=0)))
        sums.append(total[np.searchsorted(knots, case.t)])
    return x - x[0] - sums[0], float(np.abs(sums[0] - sums[1]).max(initial=0.0))
