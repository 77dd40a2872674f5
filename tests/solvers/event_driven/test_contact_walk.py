"""The machine code for contacts does what the loop in Python does; a drift is taken for A x + c only
where that is proven."""

import itertools

import numba
import numpy as np
import pytest
from plain_event_driven import run as plain
from studies import random_scenes as scenes

from nsbench import Affine, Case, Complementarity, Distance, Scale, get_case
from nsbench.linalg import skyline_cholesky
from nsbench.solvers import get, solve
from nsbench.solvers.event_driven.contacts import compiled_loop
from nsbench.solvers.event_driven.contacts.affine_drift import affine_drift
from nsbench.solvers.event_driven.contacts.kernels import first_event


def host(case, tol=1e-12):
    """The run of the loop in Python."""
    traj = solve(case, "event_driven[compiled=false]", tol=tol)
    assert traj.stats["loop"] == "host"
    return traj


def happened(traj):
    """Contacts and releases in order. Pivots are left out: which of dependent contacts carries is a
    choice."""
    return sorted((round(e.t, 8), e.kind, e.contact) for e in traj.events if e.kind != "pivot")


def agree(a, b, bound):
    off = [
        np.abs(u - v).max() / max(1.0, np.abs(v).max())
        for u, v in ((a.x, b.x), (a.reaction, b.reaction))
    ]
    assert a.status.ok and b.status.ok and max(off) <= bound, off
    first = happened(a)
    second = happened(b)
    together = len({e[0] for e in first}) == 1  # all at one instant, as in hex:
    if not together:  # which of contacts that depend on one another closes first is a rounding
        assert [e[1:] for e in first] == [e[1:] for e in second]
    assert [e[1] for e in first] == [e[1] for e in second]
    assert all(abs(e[0] - f[0]) < 1e-7 for e, f in zip(first, second, strict=True))


@pytest.mark.long
@pytest.mark.parametrize(
    "name",
    [
        "three_discs",
        "discs[n=10]",
        "discs[n=30]",
        "hex",
        "stack",
        "rods",
        "rods_wall",
        "chain",
        "wheel",
        "wedge",
        "obstacle",
        "bean",
        "two_discs",
        "kissing",
        "graze",
    ],
)
def test_cases_of_the_catalogue(name):
    case = get_case(name)
    traj = solve(case, "event_driven")
    assert traj.stats["loop"] == "compiled" and traj.stats["roots"] == "verified"
    agree(traj, host(case), 1e-12)


def affine(rng, n, mirror=False):
    """Factory of -a (x - c) + w J x + a constant kick per disc."""
    a = rng.uniform(0.3, 1.5)
    w = rng.uniform(-1.0, 1.0)
    kick = rng.uniform(-0.3, 0.3, (n, 2))
    if mirror:
        w = 0.0
        kick[n // 2 :] = kick[: n // 2] * [-1.0, 1.0]
    push = kick.ravel()
    turn = w * np.tile([-1.0, 1.0], n)
    return lambda xp: lambda t, x: push - a * x + turn * x.reshape((-1, 2))[:, ::-1].flatten()


def still(case):
    """The scene with its anchors where they are at the start."""
    stand = lambda c: (
        Distance(d=c.d, anchors=c.anchors(np)(0.0))
        if getattr(c, "anchors", None) is not None and c.moving
        else c
    )
    return case.replace(
        problem=Complementarity(
            case.problem.drift, tuple(stand(c) for c in case.problem.constraints)
        )
    )


@pytest.mark.long
@pytest.mark.parametrize("kind", [k for k in scenes.KINDS if k != "closing_box"])
def test_random_scenes(kind, monkeypatch):
    monkeypatch.setattr(scenes, "waves", affine)
    for n, seed in ((3, 1), (7, 2), (12, 3)):
        case = still(scenes.scene(kind, n, seed))
        traj = solve(case, "event_driven")
        assert traj.stats["loop"] == "compiled"
        agree(traj, host(case), 1e-11)


def test_a_list_of_neighbours_changes_nothing(monkeypatch):
    from nsbench.solvers.event_driven.contacts import evaluation

    case = get_case("discs[n=30]")
    whole = solve(case, "event_driven")
    monkeypatch.setattr(evaluation, "MAX_UNCERTIFIED_PAIRS", 0)
    agree(solve(case, "event_driven"), whole, 1e-12)


def two_clusters():
    """Ten discs drawn together here and ten there."""
    shift = np.repeat([0.0, 60.0], 20)
    pull = affine(np.random.default_rng(5), 20)
    starts = [get_case("discs", n=10, seed=k).x0 for k in (0, 1)]
    return Case(
        "two_clusters",
        Complementarity(lambda xp: lambda t, x: pull(xp)(t, x - shift), (Distance(d=2.0),)),
        np.concatenate(starts) + shift,
        np.linspace(0.0, 3.0, 7),
    )


@pytest.mark.parametrize(
    "case",
    [get_case("discs[n=30]"), get_case("discs[n=60,seed=3]"), two_clusters()],
    ids=lambda case: f"{case.name}-{case.n}",
)
def test_parts_and_sparse_factors_change_nothing(case, monkeypatch):
    """Choose active sets by dense factors for all contacts, or part by part by sparse factors."""
    from nsbench.solvers.event_driven.contacts import active_set, gram_matrix, host_loop

    whole = solve(case, "event_driven")
    shares = []

    def recorded(field, t, x, rows, labels, closed, changed):
        affected = active_set.affected_by_event(field, t, x, rows, labels, closed, changed)
        shares.append(affected[closed].mean())
        return affected

    monkeypatch.setattr(active_set, "CHOSEN_TOGETHER", 0)
    monkeypatch.setattr(host_loop, "affected_by_event", recorded)
    monkeypatch.setattr(gram_matrix, "MAX_DENSE_ROWS", 2)
    agree(solve(case, "event_driven"), whole, 1e-11)
    assert (min(shares) < 1.0) == (case.name == "two_clusters"), shares


@pytest.mark.parametrize("name", ["three_discs", "discs[n=10]"])
def test_the_plain_method_agrees(name):
    case = get_case(name)
    X, times = plain(case, 1e-12)
    traj = solve(case, "event_driven")
    found = np.unique([e.t for e in traj.events if e.kind != "pivot"])
    assert np.abs(X - traj.x).max() < 1e-9 and len(found) >= 3
    assert max(np.abs(times - t).min() for t in found) < 1e-8 and len(times) <= len(
        {e.t for e in traj.events}
    )


def drifts():
    """(factory, whether it is affine on |x| <= 3 for t in [0, 2])."""
    M = np.array([[0.0, 1.0], [-2.0, 0.5]])
    return [
        (lambda xp: lambda t, x: M @ x + 1.0, True),
        (lambda xp: lambda t, x: 0.0 * x, True),
        (lambda xp: lambda t, x: xp.stack((x[1] / 2.0 - 1.0, 3.0 * (x[0] + x[1]))), True),
        (lambda xp: lambda t, x: -x + xp.maximum(x - 3.5, 0.0), True),  # bends outside
        (lambda xp: lambda t, x: -x + xp.maximum(x - 2.9, 0.0), False),
        (lambda xp: lambda t, x: -x + xp.exp(-(((x - 2.0) / 1e-3) ** 2)), False),
        (lambda xp: lambda t, x: -x + 1e-9 * x * x, False),
        (lambda xp: lambda t, x: -x + 1e-3 * t, False),
        (lambda xp: lambda t, x: -x * (1.0 + xp.exp(-(((t - 1.3) / 1e-4) ** 2))), False),
        (lambda xp: lambda t, x: xp.where(t < 1.99, -x, x), False),
        (lambda xp: lambda t, x: -x / xp.abs(x), False),
        (lambda xp: lambda t, x: np.array([-float(x[0]), 0.0]), False),
    ]


@pytest.mark.parametrize("k", range(len(drifts())))
def test_only_affine_drifts_are_taken_for_that(k):
    drift, yes = drifts()[k]
    case = Case("drift", Complementarity(drift), np.array([0.1, 0.2]), np.linspace(0.0, 2.0, 3))
    found = affine_drift(case, 3.0)
    assert (found is not None) == yes
    if yes:
        ptr, cols, vals, c = found
        A = np.zeros((2, 2))
        A[np.repeat([0, 1], np.diff(ptr)), cols] = vals
        x = np.array([0.7, -1.9])
        np.testing.assert_allclose(A @ x + c, drift(np)(0.5, x), rtol=0, atol=1e-15)


def test_a_run_that_leaves_the_proven_box_starts_again_in_python():
    """x' = x grows out of any."""
    case = Case(
        "grows",
        Complementarity(lambda xp: lambda t, x: x, (Affine([[1.0]], [1.0]),)),
        np.ones(1),
        np.linspace(0, 6, 4),
    )
    traj = solve(case, "event_driven")
    assert traj.stats["loop"] == "host" and abs(traj.x[-1, 0] / np.exp(6.0) - 1.0) < 1e-11


@numba.njit
def _below(c, level, lo, hi):
    return first_event.first_descent(c, c.size - 1, level, lo, hi, np.empty(c.size))


def test_descents_are_those_of_the_roots():
    """Against all roots of 2000 random polynomials, and dips between two near roots down to a width
    of 1e-5."""
    rng = np.random.default_rng(3)
    for k in range(2000):
        c = rng.normal(size=rng.integers(2, 20))
        if k % 2:
            a = rng.uniform(0.1, 0.9)
            w = 10.0 ** rng.uniform(-5, -1)
            c = np.polynomial.polynomial.polymul(
                [a * a - w * w / 4, -2 * a, 1.0], np.abs(c)
            )  # a dip of width w
        roots = np.roots(c[::-1])
        real = np.sort(roots.real[np.abs(roots.imag) < 1e-12])
        edges = np.concatenate(([0.0], real[(real > 0.0) & (real < 1.0)], [1.0]))
        below = [
            a
            for a, b in itertools.pairwise(edges)
            if np.polynomial.polynomial.polyval(0.5 * (a + b), c) < -1e-13
        ]
        s = _below(c, 0.0, 0.0, 1.0)
        assert (s >= 0.0) == bool(below) or abs(np.polynomial.polynomial.polyval(s, c)) < 1e-13
        if below:
            assert abs(s - below[0]) < 1e-9 + 1e-13 / max(
                1e-9, abs(np.polynomial.polynomial.polyval(s + 1e-7, c)) / 1e-7
            )


@numba.njit
def _solved(C, V, count, n, v):
    p = count.size
    plan = skyline_cholesky.arrange(C, count, p, n)
    out = np.empty(p)
    E = np.empty(plan[2][p])
    skyline_cholesky.fill(plan, C, V, count, p, np.zeros(n), E)
    good = skyline_cholesky.factor(plan, p, E, 1e-14)
    skyline_cholesky.solve(plan, p, E, v, out)
    return good, out, E.size


@pytest.mark.long
def test_skyline_solves_as_dense_matrices_do():
    rng = np.random.default_rng(5)
    for n, p in ((6, 1), (20, 9), (60, 40), (200, 120)):
        pairs = np.sort(rng.choice(n // 2, (p, 2)), axis=1)
        pairs[:, 1] = np.minimum(pairs[:, 0] + 1 + pairs[:, 1] % 3, n // 2 - 1)
        pairs[:, 0] -= pairs[:, 0] == pairs[:, 1]
        C = np.stack(
            [2 * pairs[:, 0], 2 * pairs[:, 0] + 1, 2 * pairs[:, 1], 2 * pairs[:, 1] + 1], axis=1
        )
        V = rng.normal(size=(p, 4))
        G = np.zeros((p, n))
        np.put_along_axis(G, C, V, axis=1)
        v = rng.normal(size=p)
        good, x, size = _solved(C, V, np.full(p, 4), n, v)
        assert good == (np.linalg.matrix_rank(G) == p)
        if good:
            assert (
                np.abs(G @ (G.T @ x) - v).max() < 1e-8 * max(1.0, np.abs(x).max())
                and size <= p * (p + 1) // 2
            )


@pytest.mark.parametrize("budget, code", [("max_steps=5", "maxiter"), ("max_events=4", "chatter")])
def test_the_loop_in_python_tells_what_ends_early(budget, code):
    traj = solve(get_case("discs[n=10]"), f"event_driven[{budget}]")
    assert traj.status.code == code and traj.stats["loop"] == "host"


def test_series_of_gaps_have_all_their_coefficients():
    """A wall, two discs inside one another's length and a disc outside an anchor, in the plane."""
    rng = np.random.default_rng(2)
    deg, h = 4, 0.5
    X = rng.standard_normal((deg + 1, 4))
    powers = h ** np.arange(deg + 1)
    kind, first, other = np.array([0, 1, 2]), np.array([0, 0, 2]), np.array([0, 2, 1])
    d, sign, dim = np.array([1.0, 1.5, 0.7]), np.array([1.0, -1.0, 1.0]), np.array([0, 2, 2])
    anchors = np.array([9.0, 0.3, -0.4])
    normal = np.array([0.6, -0.8])
    layout = anchors, np.array([0, 2]), np.array([1, 3]), normal, np.array([0.25])
    series = X * powers[:, None]
    apart = series[:, 0:2] - series[:, 2:4]
    away = series[:, 2:4] - np.eye(deg + 1)[:, :1] * anchors[1:]
    out = np.empty(deg + 1)
    for k, differences in ((1, apart), (2, away)):
        square = sum(np.convolve(c, c)[: deg + 1] for c in differences.T)
        square[0] -= d[k] ** 2
        args = k, (kind, first, other, d, sign, dim), layout, X, deg, powers, np.empty(deg + 1)
        first_event._gap_series.py_func(*args, out)
        assert out == pytest.approx(0.5 * sign[k] / d[k] * square, rel=1e-12)
    first_event._gap_series.py_func(0, *args[1:], out)
    wall = series[:, [1, 3]] @ normal
    wall[0] += 0.25
    assert out == pytest.approx(wall, rel=1e-12)


def test_the_drift_and_the_steps_of_recent_arcs_are_noted(monkeypatch):
    """Rounding bands and looks ahead are taken from them."""
    drivers = []

    class Noted(compiled_loop.KernelDriver):
        def __init__(self, *args):
            super().__init__(*args)
            self.recent_steps[:] = -1.0
            drivers.append(self)

    monkeypatch.setattr(compiled_loop, "KernelDriver", Noted)
    pull = lambda xp: lambda t, x: xp.array([-1.0, 1.0 + x[1]])
    walls = Affine(np.eye(2), np.array([0.0, 4.0]))
    t = np.linspace(0.0, 2.0, 5)
    case = Case("noted", Complementarity(pull, (walls,)), np.array([1.5, 0.0]), t)
    run = solve(case.replace(scale=Scale(state=1.0, time=1.0)), "event_driven")
    assert run.stats["loop"] == "compiled" and len(run.events) == 1
    noted = drivers[-1]
    assert noted.loop.floats.drift_size[0] == pytest.approx(np.exp(1.5))  # at the event
    steps = noted.recent_steps[noted.recent_steps >= 0.0]
    assert steps.size == 1 and 0.0 < steps[0] <= t[-1]
