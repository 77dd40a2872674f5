"""Baseline: SciPy's solve_ivp with the order of modes and the events written by hand.

Each arc is integrated up to the first of its terminal events, which determines the next arc.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from nsbench.case import Case, case_names, get_case
from nsbench.compilation.factories import as_numpy
from nsbench.problem import Affine, Distance, Filippov
from nsbench.solvers.base import Claims, Run, check_positive
from nsbench.solvers.solve_ivp.hybrid_automaton import Script
from nsbench.trajectory import Event, Resolution, Status, Trajectory

METHODS = {"dop853": "DOP853", "lsoda": "LSODA", "radau": "Radau"}
TIGHTEST = 1e-13  # SciPy warns below 100 times the machine's epsilon, 2.2e-14
MOST_ARCS = 10_000


@dataclass(frozen=True)
class SolveIvp:
    """scipy.integrate.solve_ivp with terminal events and modes written by hand, for cases that
    somebody did it for.

    The baseline of the event-driven method: right-hand sides of each mode in plain Python, the
    order of modes known from pencil and paper (see hybrid_automaton.py). It is not told the
    problem; a case that is not the catalogue's own, to the bit at the start and at random places,
    is refused. method: dop853, lsoda or radau; tol: rtol and atol.
    Nothing is done about the drift off a surface that tolerances allow, and dips between steps are
    missed as SciPy misses them. Impulses (weights) are integrated with the state.
    """

    method: str = "dop853"

    accuracy: ClassVar[str] = "tol"
    default: ClassVar[float] = 1e-12
    ladder: ClassVar[tuple[float, ...]] = (1e-5, 1e-7, 1e-9, 1e-12)

    def __post_init__(self):
        if self.method not in METHODS:
            raise ValueError(f"method is {self.method!r}; one of {', '.join(METHODS)}")

    @property
    def claims(self) -> Claims:
        """Return the claimed errors at the default tolerance.

        They are bounds, twice or more of what the catalogue shows: 4.8e-11, 1.8e-11 and 8.6e-11.
        """
        return Claims(exact={"dop853": 1e-10, "radau": 1e-10, "lsoda": 1e-9}[self.method])

    def refuses(self, case: Case) -> str | None:
        """Explain why there is no script for the case; None if there is one."""
        twin = get_case(case.name, **case.params) if case.name in case_names() else None
        if twin is None or find_script(twin) is None:
            return (
                "Nobody has written modes by hand for this case; solve_ivp needs them "
                "(event_driven finds them itself)."
            )
        why = _differs(case, twin)
        return (
            f"The modes written by hand are those of the catalogue's {case.name}; this one has "
            f"{why}."
            if why
            else None
        )

    def prepare(self, case: Case, accuracy: float) -> Run:
        """Bind the script of the case; return the run with rtol = atol = accuracy.

        Raises ValueError if the tolerance is not between TIGHTEST and 0.1.
        """
        from scipy.integrate import solve_ivp

        tol = check_positive("tol", accuracy)
        if not TIGHTEST <= tol < 0.1:
            raise ValueError(
                f"tol is {tol!r}; at least {TIGHTEST:g}, below which SciPy's tolerances mean "
                f"nothing, and below 0.1"
            )
        work = find_script(case)
        arcs = {name: (arc, [_event(e) for e in arc.exits]) for name, arc in work.arcs.items()}
        return lambda: _march(case, work, arcs, solve_ivp, METHODS[self.method], tol)


def find_script(case: Case) -> Script | None:
    """Return the script of a case of the catalogue, or None if there is none."""
    from nsbench.solvers.solve_ivp import scripts_contacts, scripts_discs, scripts_filippov

    scripts = scripts_filippov.SCRIPTS | scripts_contacts.SCRIPTS | scripts_discs.SCRIPTS
    build = scripts.get(case.name)
    return build(case, **case.params) if build else None


def _event(e):
    """Wrap the function of an exit as a terminal event of SciPy, with its direction."""

    def crosses(t: float, y: np.ndarray) -> float:
        return e.when(t, y)

    crosses.terminal = True
    crosses.direction = e.direction
    return crosses


@dataclass
class _Samples:
    """State and integrals (K, size) at the recorded times, the first `done` rows filled, and what
    happened until then."""

    values: np.ndarray
    done: int = 1
    calls: int = 0
    arcs: int = 0
    events: list[Event] = field(default_factory=list)


def _march(case, work, arcs, solve_ivp, method, tol):
    """Integrate arc after arc; return the trajectory."""
    size = case.n + len(work.contacts) + (case.n if work.push is None else 0)
    samples = _Samples(np.full((len(case.t), size), np.nan))
    status = _follow_arcs(case, work, arcs, samples, solve_ivp, method, tol)
    if status.ok and not np.all(np.isfinite(samples.values)):
        status = Status("nan", "The state stopped being finite; solve_ivp did not notice.")
    return _trajectory(case, work, samples, status)


def _follow_arcs(case, work, arcs, samples, solve_ivp, method, tol):
    """Integrate from the start to the end or to a failure and fill the samples; return the status.

    arcs: by name, with the events of each as solve_ivp takes them.
    """
    times = case.t
    Y = samples.values
    t = float(times[0])
    y = np.concatenate((case.x0, np.zeros(Y.shape[1] - case.n)))
    Y[0] = y
    name = work.first
    # Event-driven integration: an arc up to its terminal event, then the arc that follows.
    while t < times[-1]:
        arc, marks = arcs[name]
        found = solve_ivp(
            lambda t, y, rhs=arc.rhs: rhs(t, y.tolist()),
            (t, times[-1]),
            y,
            method,
            times[samples.done :],
            False,
            marks,
            rtol=tol,
            atol=tol,
            max_step=work.max_step,
        )
        reached = samples.done + len(found.t)
        Y[samples.done : reached] = found.y.T if len(found.t) else Y[:0]
        samples.done = reached
        samples.calls += found.nfev
        samples.arcs += 1
        if found.status < 0:
            why = f"solve_ivp stopped in the arc {name!r} from t = {t:.6g}: {found.message}"
            return Status("diverged", why)
        if found.status == 0:
            break
        i = next(i for i, hits in enumerate(found.t_events) if len(hits))
        t = float(found.t_events[i][-1])
        y = found.y_events[i][-1].copy()
        out = arc.exits[i]
        after = out.then(t, y) if callable(out.then) else out.then
        if after != name:
            kind = out.kind(t, y) if callable(out.kind) else out.kind
            samples.events.append(Event(t, kind, out.contact))
        name = after
        arcs[name][0].enter(t, y)
        if samples.arcs >= MOST_ARCS:
            why = f"{samples.arcs} arcs have ended at t = {t:.6g}; the modes take turns."
            return Status("chatter", why)
    Y[samples.done :] = y  # an event at the very end leaves the last sample to us
    return Status()


def _trajectory(case, work, samples, status):
    """Return the trajectory: state, impulses and reaction apart."""
    n = case.n
    m = len(work.contacts)
    Y = samples.values
    W = Y[:, n : n + m].copy()
    if work.push is None:
        R = Y[:, n + m :].copy()
    else:
        R = W @ work.push if len(work.push) else np.empty((len(Y), 0))
    stats = {
        "drift_calls": samples.calls,
        "events": len(samples.events),
        "restarts": samples.arcs,
        "loop": "host",
        "roots": "sampled",
    }
    return Trajectory(
        case.t,
        Y[:, :n].copy(),
        work.contacts,
        W,
        R,
        status,
        tuple(samples.events),
        stats,
        resolution=Resolution(),
    )


def _differs(case, twin) -> str:
    """Compare two cases; return what differs, or "" if nothing does.

    Start, drift and constraints are compared at random places only.
    """
    p = case.problem
    q = twin.problem
    if type(p) is not type(q):
        return f"a problem of the kind {type(p).__name__}"
    if case.t[0] != twin.t[0] or not np.array_equal(case.x0, twin.x0) or case.start != twin.start:
        return "another start"
    rng = np.random.default_rng(0)
    for t, x in zip(rng.uniform(0.0, 3.0, 4), case.x0 + rng.normal(size=(4, case.n)), strict=True):
        if isinstance(p, Filippov):
            one = as_numpy(p.switch)(t, x)
            two = as_numpy(q.switch)(t, x)
            if not np.array_equal(one, two):
                return "another switch"
            signs = rng.uniform(-1.0, 1.0, len(one))
            one = as_numpy(p.field)(t, x, signs)
            two = as_numpy(q.field)(t, x, signs)
        else:
            one = as_numpy(p.drift)(t, x)
            two = as_numpy(q.drift)(t, x)
        if not np.array_equal(one, two, equal_nan=True):
            return "another drift"
    if not isinstance(p, Filippov) and [_data(c) for c in p.constraints] != [
        _data(c) for c in q.constraints
    ]:
        return "other constraints"
    return ""


def _data(c):
    """Return a family of constraints as plain values; walls that move at three times."""
    at = lambda v: (
        [np.asarray(as_numpy(v)(t)).tolist() for t in (0.0, 0.7, 2.3)]
        if callable(v)
        else np.asarray(v).tolist()
    )
    if isinstance(c, Affine):
        return "affine", c.indptr.tolist(), c.indices.tolist(), c.data.tolist(), at(c.b)
    if isinstance(c, Distance):
        return (
            "distance",
            c.sign,
            c.dim,
            c.start,
            c.count,
            *(None if v is None else at(v) for v in (c.d, c.radii, c.pairs, c.anchors)),
        )
    return "smooth", id(c)


SOLVER = SolveIvp
