"""Every exact solution satisfies its own equation, its constraints and complementarity, and the
check would notice.

The check shares no code with solvers: it takes the closed form between the stated events at
Chebyshev points, differentiates the interpolating polynomial (error about 1e-13 here) and puts
state, velocity and multiplier into the equation. Gaps and gradients are written out anew.
"""

from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import nnls

from nsbench import LCS, Affine, Complementarity, Distance, Filippov, get_case
from nsbench.case import case_module, case_names

P = 13  # points per panel
NODES = 0.5 - 0.5 * np.cos(np.pi * np.arange(P) / (P - 1))
LAYER = 16  # halvings: rates up to about 1e5 per unit of time
TOL = 1e-9  # state error that one panel may add; rounding is about 1e-12


def differentiation(nodes):
    """Matrix that maps values at the nodes to the derivative of the polynomial through them
    (barycentric form)."""
    gaps = nodes[:, None] - nodes[None, :] + np.eye(len(nodes))
    weights = 1.0 / gaps.prod(axis=1)
    D = weights[None, :] / weights[:, None] / gaps
    np.fill_diagonal(D, 0.0)
    np.fill_diagonal(D, -D.sum(axis=1))
    return D


SLOPE = differentiation(NODES)


def panels(case):
    """Intervals without events inside, at most a twentieth of the whole long; shorter in the layers
    of stiff cases."""
    t0 = case.t[0]
    T = case.t[-1]
    inside = [e for e in case.exact_events if t0 < e < T]
    edges = np.concatenate(([t0], np.sort(inside), [T]))
    for a, b in pairwise(edges):
        if b - a > 1e-12 * T:
            cut = np.linspace(a, b, 1 + int(np.ceil(20 * (b - a) / (T - t0))))
            if (
                "stiff" in case.tags
            ):  # a layer after each event: the first panel is halved towards it
                cut = np.concatenate(
                    (cut[:1], cut[0] + (cut[1] - cut[0]) * 0.5 ** np.arange(LAYER, 0, -1), cut[1:])
                )
            yield from pairwise(cut)


def distances(c, k, t, x):
    """Ids, gaps and gradients of one Distance family, all of it."""
    count = c.particles(x.size)
    p = x[c.start : c.start + count * c.dim].reshape(count, c.dim)
    if c.anchors is not None:
        ends = np.asarray(c.anchors(np)(t) if c.moving else c.anchors)
        pairs = c.pairs if c.pairs is not None else np.argwhere(np.ones((count, len(ends)), bool))
    else:
        ends = p
        pairs = (
            c.pairs
            if c.pairs is not None
            else np.argwhere(np.triu(np.ones((count, count), bool), 1))
        )
    i, j = pairs.T
    r = p[i] - ends[j]
    length = np.sqrt((r * r).sum(axis=1))
    d = (
        c.d
        if c.radii is None
        else np.broadcast_to(c.radii, count)[i] + np.broadcast_to(c.radii, count)[j]
    )
    G = np.zeros((len(pairs), x.size))
    rows = np.arange(len(pairs))
    for axis in range(c.dim):
        u = (
            c.sign * r[:, axis] / np.maximum(length, 1e-300)
        )  # no direction at a centre, where no contact is
        np.add.at(G, (rows, c.start + c.dim * i + axis), u)
        if c.anchors is None:
            np.add.at(G, (rows, c.start + c.dim * j + axis), -u)
    return [(k, int(a), int(b)) for a, b in pairs], c.sign * (length - d), G


def smooths(c, k, t, x):
    """Ids, gaps and gradients of a Smooth family, by differences of order six."""
    g = c.g(np)
    gap = np.asarray(g(t, x))
    h = 1e-2
    G = np.zeros((len(gap), x.size))
    for i in range(x.size):
        e = np.eye(x.size)[i] * h
        G[:, i] = sum(
            w * (g(t, x + m * e) - g(t, x - m * e)) for m, w in ((1, 45), (2, -9), (3, 1))
        ) / (60 * h)
    return [(k, r) for r in range(len(gap))], gap, G


def constraints(problem, t, x):
    """All constraints of the problem: ids, gaps (m,), gradients (m, n)."""
    ids = []
    gaps = [np.empty(0)]
    grads = [np.empty((0, x.size))]
    for k, c in enumerate(problem.constraints):
        if isinstance(c, Affine):
            A = np.zeros(c.shape)
            A[np.repeat(np.arange(c.shape[0]), np.diff(c.indptr)), c.indices] = c.data
            b = np.asarray(c.b(np)(t) if c.moving else c.b)
            part = [(k, r) for r in range(len(b))], A @ x + b, A
        else:
            part = (distances if isinstance(c, Distance) else smooths)(c, k, t, x)
        ids += part[0]
        gaps.append(part[1])
        grads.append(part[2])
    return ids, np.concatenate(gaps), np.concatenate(grads)


def columns(case, ids):
    """Where the columns of exact_impulse stand among all constraints; by default all but pairs of
    all discs."""
    free = [
        k for k, c in enumerate(case.problem.constraints) if isinstance(c, Distance) and c.all_pairs
    ]
    stated = case.contacts if case.contacts is not None else [i for i in ids if i[0] not in free]
    where = {tuple(i): at for at, i in enumerate(ids)}
    return [where[tuple(int(v) for v in c)] for c in stated]


def judge_complementarity(case, t, x, v, lam):
    """(size of the error, what is wrong) at one time; lam None: any multiplier of the active
    constraints will do."""
    ids, g, G = constraints(case.problem, t, x)
    yield -g.min(initial=0.0), "a gap is negative"
    missing = v - case.problem.drift(np)(t, x)
    if lam is None:
        active = g < 1e-8
        rest = nnls(G[active].T, missing)[1] if active.any() else np.abs(missing).max()
        yield rest, "no multipliers of the active constraints satisfy the equation"
        return
    at = columns(case, ids)
    yield np.abs(missing - lam @ G[at]).max(), "the equation is violated"
    yield -lam.min(initial=0.0), "a multiplier is negative"
    yield np.minimum(lam, g[at]).max(initial=0.0), "a multiplier acts across a gap"


def judge_filippov(case, t, x, v, theta):
    c = np.asarray(case.problem.switch(np)(t, x))
    field = case.problem.field(np)
    side = np.where(c > 0, 1.0, 0.0)
    off = np.abs(c) > 1e-8
    if theta is None:
        theta = side
        if not off.all():
            plus = field(t, x, np.ones(1))
            minus = field(t, x, -np.ones(1))
            along = plus - minus
            theta = np.array([(v - minus) @ along / (along @ along)])
    yield np.max(-theta), "a weight is negative"
    yield np.max(theta - 1.0), "a weight is above one"
    yield (
        np.max(np.abs(theta - side)[off], initial=0.0),
        "off its surface a weight is neither 0 nor 1 as the side says",
    )
    yield np.abs(v - field(t, x, 2.0 * theta - 1.0)).max(), "the inclusion is violated"


def judge_lcs(case, t, x, v, lam):
    p = case.problem
    missing = v - p.A @ x - (0.0 if p.u is None else p.u(np)(t))
    if lam is None:
        lam = nnls(p.B, missing)[0]
    w = p.C @ x + p.D @ lam + (0.0 if p.q is None else p.q(np)(t))
    yield np.abs(missing - p.B @ lam).max(), "the equation is violated"
    yield -lam.min(), "a multiplier is negative"
    yield -w.min(), "w is negative"
    yield np.minimum(lam, w).max(), "lambda and w are both positive"


JUDGES = {Complementarity: judge_complementarity, Filippov: judge_filippov, LCS: judge_lcs}


def complaint(case, exact=None, impulse=None):
    """What is wrong with the exact solution of the case (or with the one given), in a sentence;
    None if nothing."""
    exact = exact or case.exact
    impulse = impulse or case.exact_impulse
    start = case.t[:1]
    if np.abs(exact(start)[0] - case.x0).max() > 1e-13 * (1 + np.abs(case.x0).max()):
        return "the start is not x0"
    if impulse is not None and np.abs(impulse(start)).max() > 1e-13:
        return "the impulse does not start at zero"
    judge = JUDGES[type(case.problem)]
    for a, b in panels(case):
        t = a + (b - a) * NODES
        t[-1] = b
        x = exact(t)
        velocity = SLOPE @ x / (b - a)
        lam = None if impulse is None else SLOPE @ impulse(t) / (b - a)
        scale = (b - a) / (1.0 + np.abs(x).max())  # a residual counts by what it does in the panel
        for k in range(P):
            for size, what in judge(
                case, float(t[k]), x[k].copy(), velocity[k], None if lam is None else lam[k]
            ):
                if not size * (1.0 if "gap is" in what else scale) <= TOL:
                    return f"at t = {t[k]:.9g} {what} by {size:.3g}"
    return None


def solved():
    """Every parameter set named in a suite whose case knows its solution."""
    for name in case_names():
        sets = getattr(case_module(name), "SUITES", {"standard": [{}]}).values()
        for params in {str(p): p for suite in sets for p in suite}.values():
            try:
                case = get_case(name, **params)
            except (
                Exception
            ):  # test_cases says so; here it must not keep the others from being checked
                continue
            if case.exact is not None:
                yield pytest.param(case, id=case.key)


CASES = list(solved())


@pytest.mark.long
@pytest.mark.parametrize("case", CASES)
def test_exact_solution_satisfies_its_own_equation(case):
    assert case.exact_events is not None, (
        "an exact solution comes with the times of its kinks (perhaps none)"
    )
    assert all(case.t[0] <= e <= case.t[-1] for e in case.exact_events), (
        "an event outside of the run cannot be found"
    )
    assert complaint(case) is None


def test_the_cases_with_a_closed_form_are_all_here():
    names = {p.values[0].name for p in CASES}
    assert names >= {
        "apple",
        "smooth",
        "tide",
        "wedge",
        "rods",
        "duplicate",
        "hex",
        "two_discs",
        "stack",
        "chain",
        "tide_again",
        "moving_floor",
        "play",
        "dragged_disc",
        "wheel",
        "obstacle",
        "graze",
        "stiff_contact",
        "bean",
        "corner_degenerate",
        "box_turning",
        "rods_wall",
        "kissing",
    }


def bump(case):
    T = case.t[-1]
    t0 = case.t[0]
    return lambda t: 1e-6 * np.sin(np.pi * (t - t0) / (T - t0)) ** 2


@pytest.mark.parametrize("case", CASES)
def test_a_perturbed_solution_is_noticed(case):
    eps = bump(case)
    imp = case.exact_impulse
    way = np.random.default_rng(0).standard_normal(case.n)
    assert complaint(case, exact=lambda t: case.exact(t) + eps(t)[:, None] * way), (
        "a state off by 1e-6 passed"
    )
    if imp is None:
        late = complaint(case, exact=lambda t: case.exact(t + eps(t)))
    else:
        late = complaint(
            case, exact=lambda t: case.exact(t + eps(t)), impulse=lambda t: imp(t + eps(t))
        )
        size = np.abs(imp(case.t[-1:])).max()
        if size > 0.0:
            more = 1e-6 * max(1.0, 1.0 / size)
            assert complaint(case, impulse=lambda t: -imp(t)), "an impulse of the wrong sign passed"
            assert complaint(case, impulse=lambda t: imp(t) * (1.0 + more)), (
                "an impulse off by 1e-6 passed"
            )
        else:
            assert complaint(case, impulse=lambda t: imp(t) + eps(t)[:, None]), (
                "an impulse of 1e-6 from nowhere passed"
            )
    if (
        imp is not None or np.ptp(case.exact(case.t), axis=0).any()
    ):  # rest alone is the same at all times
        assert late, "events shifted by 1e-6 passed"


@pytest.mark.parametrize("case", [c for c in CASES if c.values[0].exact_events])
def test_an_event_left_out_or_misstated_is_noticed(case):
    for k in (0, -1):
        events = list(case.exact_events)
        if not case.t[0] < events[k] < case.t[-1]:
            continue
        if len(events) > 1 and np.diff(events).min() < 1e-6 and k == -1:
            continue  # events that accumulate: the last ones are as one
        events[k] += 1e-6
        assert complaint(case.replace(exact_events=tuple(events))), f"event {k} off by 1e-6 passed"


def test_the_differentiation_is_exact_for_polynomials_of_its_degree():
    for degree in range(P):
        want = degree * NODES ** max(degree - 1, 0)
        assert np.abs(SLOPE @ NODES**degree - want).max() < 1e-12
