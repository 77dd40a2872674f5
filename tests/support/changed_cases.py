"""Relations between a case and a changed one: what a unit, an origin or a bystander cannot change.

A relation makes another case of a case, and maps the trajectory of that one back. Equal bits are
expected where the relation rounds nothing: units that are powers of two. The transformations are
written for themselves, and not by nsbench.dynamics.scaling, which they test.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nsbench import LCS, Affine, Case, Complementarity, Distance, Filippov
from nsbench.solvers import get, solve

ROUNDING = 1e-9  # of a coordinate's largest value: relations that round, at most


@dataclass(frozen=True)
class Changed:
    """A changed case. factor: of times, for accuracies h. back: its states (k, n) in the old ones.

    impulse: factor of impulses, reaction of reactions; origin: its time t for the old time 0;
    stiffness: factor of a penalty's k.
    """

    case: Case
    back: Callable = lambda x: x
    time: float = 1.0
    impulse: float = 1.0
    reaction: float = 1.0
    origin: float = 0.0
    stiffness: float = 1.0


def _field(factory, M, inverse, shift, T, t0):
    """Factory of M f((t - t0) / T, inverse (y - shift), ...) / T."""

    def make(xp):
        f = factory(xp)
        to = np.ascontiguousarray(M / T)
        back = np.ascontiguousarray(inverse)
        off = shift + 0.0
        if xp.__name__ != "numpy":
            to, back, off = xp.asarray(to), xp.asarray(back), xp.asarray(off)
        return lambda t, y, *s: to @ f((t - t0) / T, back @ (y - off), *s)

    return make


def _scalar(factory, S, T, t0, factor):
    """Factory of factor f((t - t0) / T, y / S, ...), S a number or (n,)."""

    def make(xp):
        f = factory(xp)
        size = S + np.zeros(1)
        unit = factor + np.zeros(1)
        if xp.__name__ != "numpy":
            size, unit = xp.asarray(size), xp.asarray(unit)
        return lambda t, y, *s: f((t - t0) / T, y / size, *s) * unit

    return make


def _curve(b, T, t0, factor):
    if b is None or not callable(b):
        return None if b is None else b * factor

    def make(xp):
        f = b(xp)
        return lambda t: f((t - t0) / T) * factor

    return make


def units(case: Case, time: float = 1.0, length=1.0, gap: float = 1.0, origin: float = 0.0):
    """The case in other units of time, of coordinates (one, or (n,)), and of switches and gaps."""
    p = case.problem
    t = origin + time * case.t
    S = np.broadcast_to(np.asarray(length, float), (case.n,)).copy()
    if isinstance(p, Filippov):
        problem = Filippov(
            None,
            _scalar(p.switch, S, time, origin, gap),
            _scalar(p.field, S, time, origin, S / time),
            p.d,
        )
        impulse = time
        stiffness = 1.0 / gap
    elif isinstance(p, LCS):
        problem = LCS(
            (p.A * S[:, None]) / S / time,
            p.B * S[:, None] / time,
            p.C / S,
            p.D,
            _curve(p.u, time, origin, S / time),
            _curve(p.q, time, origin, 1.0),
        )
        impulse = time
        stiffness = 1.0
    else:
        L = float(S[0])
        families = tuple(_family(c, L, gap, time, origin) for c in p.constraints)
        problem = Complementarity(_scalar(p.drift, L, time, origin, L / time), families)
        impulse = L / gap
        stiffness = 1.0 / (time * gap**2)
    made = dataclasses.replace(
        case, problem=problem, x0=case.x0 * S, t=t, exact=None, exact_impulse=None,
        exact_events=None, distance=None, scale=None,
    )  # fmt: skip
    return Changed(made, lambda x: x / S, time, impulse, S, origin, stiffness)


def _family(c, L, gap, time, origin):
    if isinstance(c, Affine):
        A = np.zeros(c.shape)
        rows = np.repeat(np.arange(c.shape[0]), np.diff(c.indptr))
        A[rows, c.indices] = c.data * gap
        return Affine(A, _curve(c.b, time, origin, L * gap))
    if isinstance(c, Distance):
        if gap != 1.0:
            raise NotImplementedError("a distance has the unit of length")
        sizes = {k: getattr(c, k) * L for k in ("d", "radii") if getattr(c, k) is not None}
        return dataclasses.replace(c, anchors=_curve(c.anchors, time, origin, L), **sizes)
    one = gap / L
    return dataclasses.replace(
        c,
        g=_scalar(c.g, L, time, origin, L * one * L),
        gradient=c.gradient and _scalar(c.gradient, L, time, origin, one * L),
        rate=c.rate and _scalar(c.rate, L, time, origin, L * one * L / time),
    )


def moved(case: Case, M: np.ndarray, shift) -> Changed:
    """A system in the coordinates y = M x + shift, M orthogonal.

    Of a gradient system M must leave its constraints as they are: hard particles of one size that
    are turned together or exchanged.
    """
    p = case.problem
    inverse = M.T
    shift = np.broadcast_to(np.asarray(shift, float), (case.n,)).copy()
    if isinstance(p, Complementarity):
        problem = Complementarity(_field(p.drift, M, inverse, shift, 1.0, 0.0), p.constraints)
        made = case.replace(problem=problem, x0=M @ case.x0 + shift, exact=None, exact_impulse=None)
        return Changed(made, lambda y: (y - shift) @ inverse.T)
    c = p.switch

    def switch(xp):
        f = c(xp)
        back = np.ascontiguousarray(inverse)
        off = shift + 0.0
        if xp.__name__ != "numpy":
            back, off = xp.asarray(back), xp.asarray(off)
        return lambda t, y: f(t, back @ (y - off))

    problem = Filippov(None, switch, _field(p.field, M, inverse, shift, 1.0, 0.0), p.d)
    made = case.replace(problem=problem, x0=M @ case.x0 + shift, exact=None, exact_impulse=None)
    return Changed(made, lambda y: (y - shift) @ inverse.T)


def beside(case: Case, value: float) -> Changed:
    """A Filippov system with one more coordinate that rests at `value`."""
    p = case.problem
    n = case.n

    def field(xp):
        f = p.field(xp)
        return lambda t, x, s: xp.concatenate((f(t, x[:n], s), 0.0 * x[n:]))

    def switch(xp):
        c = p.switch(xp)
        return lambda t, x: c(t, x[:n])

    made = case.replace(
        problem=Filippov(None, switch, field, p.d), x0=np.append(case.x0, value), exact=None,
        exact_impulse=None,
    )  # fmt: skip
    return Changed(made, lambda x: x[:, :n])


def longer(case: Case, times: float) -> Changed:
    """The case with a further sample at `times` its end."""
    t = np.append(case.t, case.t[0] + times * (case.t[-1] - case.t[0]))
    return Changed(case.replace(t=t, exact=None, exact_impulse=None), lambda x: x[: len(case.t)])


def doubled(case: Case) -> Changed:
    """The case with every row of its constraints twice."""
    p = case.problem
    rows = tuple(c for c in p.constraints if isinstance(c, Affine))
    problem = Complementarity(p.drift, (*p.constraints, *rows))
    return Changed(case.replace(problem=problem, exact=None, exact_impulse=None))


def run(case: Case, spec: str, accuracy: float | None = None, time=1.0, stiffness=1.0):
    """Run a method at its default accuracy, or another one, in the units of the changed case."""
    method = get(spec)
    value = accuracy or method.default
    factor = {"h": time, "k": stiffness}.get(method.accuracy, 1.0)
    return solve(case, spec, **{method.accuracy: value * factor})


def differences(case: Case, spec: str, changed: Changed, accuracy: float | None = None) -> dict:
    """Run both; return the largest differences of states, impulses, reactions and event times.

    Old run: of the case, its functions wrapped as the changed ones are. Differences are in parts of
    the largest value of a coordinate in the old run; status: the two, if they differ.
    """
    a = run(units(case).case, spec, accuracy)  # wrapped too: the same functions, compiled alike
    return differences_from(case, a, spec, changed, accuracy)


def differences_from(case: Case, a, spec: str, changed: Changed, accuracy: float | None = None):
    """As `differences`, with the old run a at hand."""
    b = run(changed.case, spec, accuracy, changed.time, changed.stiffness)
    if a.status.code != b.status.code:
        return {"status": (a.status.code, b.status.code)}
    k = len(a.t)
    gradient = isinstance(case.problem, Complementarity)
    units_of = {"x": gradient, "reaction": gradient, "impulse": not isinstance(case.problem, LCS)}
    pairs = {"x": (a.x, changed.back(b.x)[:k])}
    if b.impulse.shape[1] and a.impulse.shape[1]:
        pairs["impulse"] = _of_same_contacts(a, b, changed.impulse)
    if a.reaction.shape[1] and b.reaction.shape[1] == a.reaction.shape[1]:
        pairs["reaction"] = (a.reaction, b.reaction[:k] / changed.reaction)
    out = {}
    for name, (old, new) in pairs.items():
        size = np.nanmax(np.abs(old), axis=0, initial=0.0)
        if name == "reaction":  # has the unit of a state, and may be zero but for rounding
            size = np.maximum(size, np.nanmax(np.abs(a.x), axis=0, initial=0.0))
        if units_of[name]:
            size = np.full(size.shape, size.max(initial=0.0))
        size = np.where(size > 0.0, size, 1.0)
        same = np.array_equal(old, new, equal_nan=True)
        out[name] = 0.0 if same else float(np.nanmax(np.abs(new - old) / size, initial=0.0))
    apart = _events_apart(case, a, b, changed)
    return out if apart is None else out | {"events": apart}


def _of_same_contacts(a, b, factor):
    """Impulses of both runs with a column for each contact of either: contacts act in any order.

    A contact that is missing has no impulse.
    """
    names = list(dict.fromkeys((*a.contacts, *b.contacts)))
    columns = [
        [run.impulse[:, run.contacts.index(c)] if c in run.contacts else 0.0 * run.t for c in names]
        for run in (a, b)
    ]
    old, new = (np.stack(c, axis=1) for c in columns)
    return old, new[: len(a.t)] / factor


def _events_apart(case, a, b, changed):
    """Return how far apart the events of each kind and contact are, in parts of the run.

    None without events; inf where one run has one that the other lacks.
    """
    end = float(case.t[-1])
    times = ({}, {})
    for e in a.events:
        if e.t < end:
            times[0].setdefault((e.kind, e.contact), []).append(e.t)
    for e in b.events:
        if (t := (e.t - changed.origin) / changed.time) < end:
            times[1].setdefault((e.kind, e.contact), []).append(t)
    if not times[0] and not times[1]:
        return None
    first, second = times
    if {k: len(v) for k, v in first.items()} != {k: len(v) for k, v in second.items()}:
        return np.inf
    far = max(np.abs(np.subtract(sorted(v), sorted(second[k]))).max() for k, v in first.items())
    return float(far / (end - case.t[0]))
