"""The Reference dataclass, and references from closed forms: states, impulses, events, reaction."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from nsbench.case import Case
from nsbench.compilation.factories import as_numpy
from nsbench.problem import LCS, Affine, Complementarity, Distance, Filippov, Hybrid, Problem
from nsbench.trajectory import Event

EPS = float(np.finfo(float).eps)
FINE = 1e-15  # relative; halves that agree with the whole to this add no more than rounding
# of a piece, at most and at least
HALVINGS = 24
TWICE = 2
# Impulses worse known than this, and than so many times the reaction (relative, both) are not known
# as well as it: their gradients are nearly dependent.
IMPULSE_UNKNOWN = 1e-8
IMPULSE_WORSE = 1e3


@dataclass(frozen=True, eq=False, repr=False)
class Reference:
    """Hold the known solution at the sample times, with bounds of its own error.

    t (k,), x (k, n); contacts: ids of the m columns of impulse (k, m), or impulse None if it is not
    known; reaction (k, n) or None (Filippov); events: Event with kind "" if only the time is known,
    or None (unknown).

    state_error, impulse_error, reaction_error: bounds of its own error in the max norm, NaN for
    what is None; event_error: bound of the event times, NaN if there are none. kind: "closed form",
    "stored" (two runs that agree) or "certified" (proven); how: what made it; versions: of the
    libraries that did. shown: further digits of a certified one, {"times": [...], "final": [...]}
    as decimals.
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

    @property
    def knows_impulse(self) -> bool:
        """Are the impulses known as well as the reaction, each relative to its largest value?

        Not where multipliers are nearly not unique: of almost dependent gradients the sum is known
        far better than its parts. True where one of the two is missing.
        """
        if self.impulse is None or self.reaction is None:
            return True
        impulse, reaction = (
            error / max(1.0, float(np.abs(values).max(initial=0.0)))
            for error, values in (
                (self.impulse_error, self.impulse),
                (self.reaction_error, self.reaction),
            )
        )
        return not (impulse > IMPULSE_UNKNOWN and impulse > IMPULSE_WORSE * reaction)

    def __repr__(self) -> str:
        """Return kind, sizes and bound; the arrays are attributes."""
        return f"Reference({self.kind}, x {self.x.shape}, state to {self.state_error:.1e})"

    def __str__(self) -> str:
        known = (
            ("state", self.state_error),
            ("impulse", self.impulse_error),
            ("reaction", self.reaction_error),
            ("event times", self.event_error),
        )
        bounds = ", ".join(f"{name} to {v:.1e}" for name, v in known if not np.isnan(v))
        return f"{self.kind}, {bounds}{'; ' + self.how if self.how else ''}"


def closed_form(case: Case) -> Reference:
    """Build the reference from case.exact, exact_impulse and exact_events.

    Its own error is the rounding of the formulas.
    """
    t = case.t
    x = _checked(case, "exact", case.exact(t), (len(t), case.n))
    scale = max(1.0, float(np.abs(x).max(initial=0.0)))
    impulse = None
    ids = ()
    if case.exact_impulse is not None:
        ids = tuple(case.contacts) if case.contacts is not None else listed_contacts(case)
        impulse = _checked(case, "exact_impulse", case.exact_impulse(t), (len(t), len(ids)))
    times = case.exact_events
    events = (
        None
        if times is None
        else tuple(e if isinstance(e, Event) else Event(float(e), "", ()) for e in times)
    )
    f = right_hand_side(case.problem)
    if impulse is not None and _constant_gradients(case.problem):
        reaction = _along_rows(case, impulse, ids)
        quadrature = 0.0
    else:
        reaction, quadrature = (
            (None, float("nan")) if f is None else _reaction(case, f, x, events or ())
        )
    size = scale if impulse is None else max(scale, float(np.abs(impulse).max(initial=0.0)))
    return Reference(
        t,
        x,
        ids,
        impulse,
        reaction,
        events,
        4 * EPS * scale,
        float("nan") if impulse is None else 4 * EPS * size,
        quadrature + 4 * EPS * size,
        event_error=float("nan") if not events else 4 * EPS * max(1.0, float(np.abs(t).max())),
    )


def _checked(case, name, value, shape):
    """Return a closed form's values as float64 of the given shape; raise ValueError if they are not
    finite or of another shape.
    """
    value = np.asarray(value)
    if value.dtype.kind not in "fiu" or value.dtype in (np.float32, np.float16):
        raise TypeError(f"{name} of {case.key} returns {value.dtype}; float64 is needed")
    value = np.asarray(value, float)
    if value.shape != shape or not np.all(np.isfinite(value)):
        raise ValueError(
            f"{name} of {case.key} returns shape {value.shape}; finite values of shape {shape} "
            f"are needed"
        )
    return value


def right_hand_side(problem: Problem) -> Callable | None:
    """Return f(t, x) without the multipliers' part, in numpy; None for Filippov and hybrid systems,
    which have several fields.
    """
    if isinstance(problem, Complementarity):
        return as_numpy(problem.drift)
    if isinstance(problem, LCS):
        u = as_numpy(problem.u) if problem.u else lambda t: 0.0
        return lambda t, x: problem.A @ x + u(t)
    return None


def listed_contacts(case: Case) -> tuple:
    """List the ids of the rows of the families in order (all pairs excepted), or of the surfaces or
    modes of the other classes.
    """
    p = case.problem
    if isinstance(p, Complementarity):
        from nsbench.dynamics.contacts.constraint_set import ConstraintSet

        return tuple(ConstraintSet(p, case.n).all_static().ids)
    if isinstance(p, LCS):
        return tuple((0, i) for i in range(p.B.shape[1]))
    if isinstance(p, Hybrid):
        return p.contacts
    return tuple(
        (0, i) for i in range(len(np.asarray(as_numpy(p.switch)(float(case.t[0]), case.x0))))
    )


def canonical(problem: Problem, contact: tuple[int, ...]) -> tuple:
    """Order a contact's id so that i < j where both are particles of one family."""
    c = tuple(int(v) for v in contact)
    if len(c) == 3 and c[1] > c[2] and isinstance(problem, Complementarity):
        family = problem.constraints[c[0]]
        if isinstance(family, Distance) and family.anchors is None:
            return c[0], c[2], c[1]
    return c


def spread(
    problem: Problem,
    contacts: Sequence[tuple],
    values: np.ndarray,
    columns: dict,
) -> np.ndarray:
    """Place `values` (k, m) of `contacts` on the `columns` {id: column}; absent
    contacts are zero.
    """
    out = np.zeros((len(values), len(columns)))
    for k, c in enumerate(contacts):
        out[:, columns[canonical(problem, c)]] += values[:, k]
    return out


def columns_of(problem: Problem, *lists: Sequence[tuple]) -> dict:
    """Assign one column to every contact of the lists of ids."""
    return {
        c: k for k, c in enumerate(sorted({canonical(problem, c) for ids in lists for c in ids}))
    }


def _constant_gradients(problem) -> bool:
    return (
        isinstance(problem, Complementarity)
        and bool(problem.constraints)
        and all(isinstance(c, Affine) for c in problem.constraints)
    )


def _along_rows(case, impulse, ids):
    """Compute the reaction where gradients are rows of A, from the impulses alone.

    No quadrature of the drift, which a stiff layer would spoil.
    """
    out = np.zeros((len(impulse), case.n))
    for column, (family, row) in zip(impulse.T, ids, strict=True):
        c = case.problem.constraints[family]
        part = slice(c.indptr[row], c.indptr[row + 1])
        out[:, c.indices[part]] += column[:, None] * c.data[part]
    return out


def _reaction(case, f, x, events):
    """Compute R(t) = x(t) - x(t0) - integral of f(s, x(s)) ds and a bound of its error: (k, n)
    each.

    Gauss rules of 12 nodes on pieces split at the events; a piece is halved until it agrees with
    its halves to rounding, at least TWICE: a layer of a stiff drift is thinner than the distance of
    the nodes.
    """
    cuts = np.array([e.t for e in events if case.t[0] < e.t < case.t[-1]])
    knots = np.unique(np.concatenate((case.t, cuts)))
    a = knots[:-1]
    b = knots[1:]
    owner = np.arange(len(knots) - 1)
    total = np.zeros((len(owner), case.n))
    error = 0.0
    whole = _gauss(case, f, a, b)
    size = 1.0 + np.abs(whole).sum(axis=0).max(initial=0.0)
    for depth in range(HALVINGS):
        mid = 0.5 * (a + b)
        left = _gauss(case, f, a, mid)
        right = _gauss(case, f, mid, b)
        off = np.abs(left + right - whole).max(axis=1, initial=0.0)
        open_ = (
            (off > FINE * size) & (depth < HALVINGS - 1)
            if depth >= TWICE
            else np.ones(len(off), bool)
        )
        np.add.at(total, owner[~open_], (left + right)[~open_])
        error += float(off[~open_].sum())
        a = np.concatenate((a[open_], mid[open_]))
        b = np.concatenate((mid[open_], b[open_]))
        owner = np.tile(owner[open_], 2)
        whole = np.concatenate((left[open_], right[open_]))
        if not len(a):
            break
    integral = np.concatenate((np.zeros((1, case.n)), np.cumsum(total, axis=0)))[
        np.searchsorted(knots, case.t)
    ]
    return x - x[0] - integral, error


def _gauss(case, f, a, b):
    """Integrate f(s, x(s)) over the intervals [a_i, b_i] by a Gauss rule: (len(a), n)."""
    node, weight = np.polynomial.legendre.leggauss(12)
    half = 0.5 * (b - a)
    s = (a + half)[:, None] + half[:, None] * node
    states = np.asarray(case.exact(s.ravel()), float)
    values = np.array([f(t, y) for t, y in zip(s.ravel(), states, strict=True)]).reshape(
        *s.shape, case.n
    )
    return np.einsum("pgn,pg->pn", values, half[:, None] * weight)
