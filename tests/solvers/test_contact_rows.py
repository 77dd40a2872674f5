"""Contacts as the error bars read them: gaps, gradients by entries, projection on their cone."""

import numpy as np
import pytest
from scipy.sparse import csr_array

import nsbench
from nsbench import Affine, Complementarity, Distance, Smooth
from nsbench.compilation.decorators import python_entry
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.error_bars.contact_rows import ContactRows
from nsbench.error_bars.drift import Drift
from nsbench.error_bars.kernels.cone_projection import _least_change, _one_by_one
from nsbench.error_bars.kernels.gram import DAMPING, gram_multipliers
from nsbench.error_bars.kernels.local_piece import follow_piece
from nsbench.error_bars.kernels.unit_gradients import chosen, every_row, gaps_and_gradients
from nsbench.error_bars.shadow import Shadow
from nsbench.error_bars.unit_gradients import UnitGradients
from nsbench.linalg.skyline_cholesky import arrange


def _at_rest(xp):
    return lambda t, x: 0.0 * x


def _ring(xp):
    return lambda t, x: xp.array([x[0] ** 2 + x[1] ** 2 - 1.0 + t, x[2] - 3.0 * x[3]])


WIDE = np.array([[2.0, 0.0, -1.0, 0.0, 0.0, 3.0], [0.0, 5.0, 0.0, 0.0, 0.0, 0.0]])
MIXED = Complementarity(
    _at_rest,
    (
        Affine(WIDE, b=np.ones(2)),
        Distance(0.5),
        Distance(2.0, pairs=np.array([[0, 2]]), sign=-1),
        Distance(0.3, anchors=np.array([[1.0, 1.0], [4.0, -2.0]])),
        Smooth(_ring),
    ),
)


def _mixed_rows():
    scene = ConstraintSet(MIXED, 6)
    near = scene.near(np.zeros(6), np.inf)
    return scene, near, ContactRows(scene, near.ids, near)


def test_gaps_and_gradients_of_contacts_of_every_kind_are_those_of_the_scene():
    scene, near, rows = _mixed_rows()
    rng = np.random.default_rng(0)
    t = rng.uniform(size=3)
    X = rng.normal(size=(3, 6))
    gaps, N = rows.gaps_and_gradients(t, X)
    assert np.array_equal(gaps, rows.gaps(t, X))
    for s in range(3):
        G = scene.dense_gradients(t[s], X[s], near)
        lengths = np.linalg.norm(G, axis=1)
        assert np.allclose(gaps[s], scene.gaps(t[s], X[s], near) / lengths, rtol=1e-14, atol=1e-14)
        assert np.allclose(N.dense()[s], G / lengths[:, None], rtol=1e-14, atol=1e-14)


def test_rows_that_are_chosen_are_those_of_all():
    _, _, rows = _mixed_rows()
    listed = rows.as_list
    every = python_entry(every_row)(listed.scene, listed.columns, listed.count, 6)
    for index in ([1, 0], [3, 5], [rows.m - 1], list(range(rows.m))):
        is_chosen = np.isin(np.arange(rows.m), index)
        some = python_entry(chosen)(listed.scene, every, is_chosen, 6)
        assert some.at.tolist() == sorted(index)
        assert some.is_straight == (max(index) < 2)
        assert np.array_equal(some.C, every.C[sorted(index)])
        assert np.array_equal(some.count, every.count[sorted(index)])


def test_a_row_that_lists_a_coordinate_twice_is_its_sum():
    twice = csr_array(([1.0, 3.0, 3.0], [0, 0, 1], [0, 3]), shape=(1, 2))
    scene = ConstraintSet(Complementarity(_at_rest, (Affine(twice, b=np.zeros(1)),)), 2)
    rows = ContactRows(scene, [(0, 0)])
    gaps, N = rows.gaps_and_gradients(np.zeros(1), np.array([[5.0, 10.0]]))
    assert gaps[0, 0] == pytest.approx(10.0)
    assert np.allclose(N.dense()[0, 0], [0.8, 0.6])
    assert np.allclose(N.multipliers(np.ones((1, 1))), 1.0, rtol=1e-9)


def kernels_of(problem, n, drift=None):
    scene = ConstraintSet(problem, n)
    return Shadow(scene, Drift(drift or problem.drift, n)).kernels


def test_a_piece_ends_where_the_first_gap_closes():
    """x = 1 - 2 t and y = 1 - 8 t^3 reach the walls x >= 0.25 and y >= 0.5 at t = 0.375 and at the
    cube root of 1/16."""

    def fall(xp):
        return lambda t, x: xp.array([-2.0 + 0.0 * t, -24.0 * t**2])

    both = Affine(np.diag([4.0, 1.0]), b=np.array([-1.0, -0.5]))
    upper = Affine(np.array([[0.0, 1.0]]), b=np.array([-0.5]))
    for wall, length, gap in ((both, 0.375, 0), (upper, 16.0 ** (-1 / 3), 0)):
        kernels = kernels_of(Complementarity(fall, (wall,)), 2)
        rows, piece = kernels.follow_piece(0.0, 1.0, np.ones(2))
        assert piece.length == pytest.approx(length, abs=1e-12) and piece.is_cut
        assert piece.slack < 1e-12 and not len(piece.closed)
        left = rows.gaps(np.array([length]), piece.end[None])[0, gap]
        assert abs(left) <= 1e-12
    _, piece = kernels.follow_piece(0.0, 0.3, np.ones(2))
    assert piece.length == 0.3 and not piece.is_cut
    with pytest.raises(ArithmeticError, match="not finite"):
        kernels.follow_piece(0.0, np.nan, np.ones(2))
    # a kernel is compiled for the types of its first call: times are floats, whatever is given
    others = kernels_of(Complementarity(fall, (wall,)), 2)
    assert others.follow_piece(0, 1, np.ones(2))[1].length == pytest.approx(16.0 ** (-1 / 3))
    expected = kernels.follow_piece(0.25, 0.125, np.ones(2))[1]
    found = others.follow_piece(0.25, 0.125, np.ones(2))[1]
    assert found.length == 0.125 and np.array_equal(found.end, expected.end)


def test_a_piece_ends_where_the_first_multiplier_vanishes():
    """On the floor y >= 0 under gravity cos t the ground pushes until t = pi / 2."""

    def weight(xp):
        return lambda t, x: xp.array([1.0 + 0.0 * t, -xp.cos(t)])

    floor = Affine(np.array([[0.0, 2.0]]), b=np.zeros(1))
    kernels = kernels_of(Complementarity(weight, (floor,)), 2)
    rows, piece = kernels.follow_piece(0.0, 2.0, np.zeros(2))
    assert piece.length == pytest.approx(np.pi / 2, abs=1e-5) and piece.is_cut
    assert piece.acting.tolist() == [0] and rows.ids[0] == (0, 0)
    quarters = np.arange(5) * piece.length / 4
    assert np.allclose(piece.loads[:, 0], np.cos(quarters), atol=1e-5)
    assert np.allclose(piece.end, [piece.length, 0.0], atol=1e-12)


def ring(xp):
    return lambda t, x: xp.array([x[0] ** 2 + x[1] ** 2 - 1.0])


def ring_gradient(xp):
    return lambda t, x: xp.array([[2.0 * x[0], 2.0 * x[1]]])


def still(xp):
    return lambda t, x: xp.zeros(1) + 0.0 * t


def rising(xp):
    return lambda t: xp.array([-1.0 - 0.25 * xp.sin(t)])


ROUND = {
    "anchor": Distance(1.0, anchors=np.zeros((1, 2))),
    "Smooth": Smooth(ring, ring_gradient, still),
}


@pytest.mark.parametrize("kind", ROUND)
def test_a_piece_slides_round_a_disc(kind):
    """x' = (1, 0) slides over the unit disc from (-0.8, 0.6): its angle a has a' = -sin a."""
    east = lambda xp: lambda t, x: xp.array([1.0, 0.0]) + 0.0 * x
    kernels = kernels_of(Complementarity(east, (ROUND[kind],)), 2)
    _, piece = kernels.follow_piece(0.0, 0.05, np.array([-0.8, 0.6]))
    start = 2.0 * np.arctan2(0.6, -0.8 + 1.0) / 1.0
    half = np.tan(0.5 * start) * np.exp(-0.05)
    exact = 2.0 * np.arctan(half)
    assert np.allclose(piece.end, [np.cos(exact), np.sin(exact)], atol=1e-8)
    assert piece.acting.tolist() == [0]
    assert piece.loads[0, 0] == pytest.approx(0.8, abs=1e-9)


def uncompiled(drift):
    """The same drift, as numba cannot compile it."""

    def make(xp):
        f = drift(xp)
        return lambda t, x: np.array([float(repr(float(v))) for v in f(t, x)])

    return make


@pytest.mark.parametrize("name", ["discs[n=3]", "wedge", "tide", "chain"])
def test_a_piece_in_python_is_that_of_the_kernel(name):
    """Where a drift cannot be compiled its source runs in Python, with the same numbers."""
    case = nsbench.get_case(name)
    compiled = kernels_of(case.problem, case.n)
    plain = kernels_of(case.problem, case.n, uncompiled(case.problem.drift))
    assert compiled._loop == "compiled" and plain._loop == "host"
    y = np.array(case.x0, float)
    t = float(case.t[0])
    for _ in range(4):
        rows, one = compiled.follow_piece(t, float(case.t[-1]) / 9, y)
        others, other = plain.follow_piece(t, float(case.t[-1]) / 9, y)
        assert rows.ids == others.ids
        for a, b in zip(one, other, strict=True):
            assert np.allclose(a, b, rtol=1e-9, atol=1e-13)
        y = one.end
        t += one.length


def test_no_pair_that_comes_near_is_missed_between_two_listings():
    case = nsbench.get_case("discs[n=30]")
    scene = ConstraintSet(case.problem, case.n)
    kernels = kernels_of(case.problem, case.n)
    rng = np.random.default_rng(2)
    y = np.array(case.x0, float)
    dt = 0.1 / np.linalg.norm(Drift(case.problem.drift, case.n)(0.0, y))
    listed = set()
    for _ in range(200):
        y = y + 0.01 * rng.normal(size=case.n)
        rows, _ = kernels.follow_piece(0.0, dt, y)
        listed.add(id(rows))
        assert set(scene.near(y, 0.35).ids) <= set(rows.ids)
    assert 1 < len(listed) < 100
    assert kernels.follow_piece(0.0, 0.01 * dt, y)[0].m < rows.m


def test_a_drift_that_numba_cannot_compile_has_the_same_values():
    def drift(xp):
        return lambda t, x: xp.sin(t) * x - x**3

    def in_python(xp):
        return lambda t, x: np.array(list({k: drift(np)(t, x)[k] for k in range(3)}.values()))

    t = np.linspace(0.0, 1.0, 4)
    X = np.arange(12.0).reshape(4, 3)
    units = 0.25, 8.0, 0.5
    compiled = Drift(drift, 3, *units)
    plain = Drift(in_python, 3, *units)
    assert compiled.is_compiled
    assert not plain.is_compiled
    assert np.allclose(compiled.at(t, X), plain.at(t, X), rtol=1e-14)
    assert np.array_equal(compiled(t[1], X[1]), compiled.at(t, X)[1])
    exact = 16.0 * drift(np)(0.25 + 8.0 * t[:, None], 0.5 * X)
    assert np.allclose(compiled.at(t, X), exact, rtol=1e-14)


def _normals(rng, states: int, particles: int, contacts: int) -> np.ndarray:
    """Unit gradients (states, contacts, 2 particles) of pairs drawn at random; the last one is
    the first, twice."""
    N = np.zeros((states, contacts, 2 * particles))
    for k in range(contacts - 1):
        i, j = rng.choice(particles, 2, replace=False)
        unit = rng.normal(size=(states, 2))
        unit /= np.sqrt(2.0) * np.linalg.norm(unit, axis=1, keepdims=True)
        N[:, k, 2 * i : 2 * i + 2] = unit
        N[:, k, 2 * j : 2 * j + 2] = -unit
    N[:, -1] = N[:, 0]
    return N


@pytest.mark.parametrize("contacts", [2, 15, 40])
@pytest.mark.parametrize("states", [1, 7])
def test_multipliers_in_the_envelope_are_those_of_the_dense_gram_matrix(states, contacts):
    rng = np.random.default_rng(contacts)
    N = _normals(rng, states, 30, contacts)
    g = (N @ rng.normal(size=(states, 60, 1)))[..., 0]
    gram = N @ N.transpose(0, 2, 1)
    plain = np.linalg.solve(gram + DAMPING * np.eye(contacts), g[..., None])[..., 0]
    found = UnitGradients.of(N).multipliers(g)
    assert np.allclose(found, plain, rtol=1e-4, atol=1e-4)
    closed = (gram @ found[..., None])[..., 0]
    assert np.abs(closed - g).max() < 1e-7
    refined = (gram @ UnitGradients.of(N).multipliers(g, is_refined=True)[..., None])[..., 0]
    assert np.abs(refined - g).max() < 1e-13


def test_gradients_that_are_the_same_at_all_states_are_factored_once():
    rng = np.random.default_rng(4)
    N = _normals(rng, 1, 30, 20)
    g = rng.normal(size=(5, 20))
    d = rng.normal(size=(5, 60))
    once = UnitGradients.of(N)
    each = UnitGradients.of(np.repeat(N, 5, axis=0))
    assert np.array_equal(once.multipliers(g, True), each.multipliers(g, True))
    assert np.array_equal(once.times(d), each.times(d))
    for found, expected in zip(once.off_cone(d), each.off_cone(d), strict=True):
        assert np.array_equal(found, expected)


def test_arrays_that_may_not_be_written_to_compile_no_second_version():
    rng = np.random.default_rng(3)
    N = _normals(rng, 1, 30, 20)
    g = rng.normal(size=(1, 20))
    known = UnitGradients.of(N).multipliers(g)
    for array in (N, g):
        array.flags.writeable = False
    assert np.array_equal(UnitGradients.of(N).multipliers(g), known)
    assert len(gram_multipliers.signatures) == 1
    for scene in ("discs[n=3]", "moving_floor", "bean", "chain"):
        case = nsbench.get_case(scene)
        nsbench.solve(case, "pbd", h=case.t[1] - case.t[0]).bound.state.max()
    for kernel in (follow_piece, gaps_and_gradients):
        assert len(kernel.signatures) == 1


def test_what_is_off_a_cone_is_the_shortest_rest():
    """Block pivoting against nonnegative least squares, of normals that depend on one another."""
    from scipy.optimize import nnls

    rng = np.random.default_rng(5)
    for contacts in (2, 9, 30):
        N = _normals(rng, 20, 12, contacts)
        d = rng.normal(size=(20, 24))
        rest, q = UnitGradients.of(N).off_cone(d)
        assert q.min() >= 0.0
        assert np.allclose(d - rest, (q[:, None] @ N)[:, 0], atol=1e-12)
        for k in range(20):
            assert np.linalg.norm(rest[k]) == pytest.approx(nnls(N[k].T, d[k])[1], abs=1e-8)


def test_rows_are_added_one_by_one_where_pivoting_would_cycle():
    """Nonnegative least squares of another make, of normals that depend on one another."""
    from scipy.optimize import nnls

    one_by_one = python_entry(_one_by_one)
    plan_of = python_entry(arrange)
    rng = np.random.default_rng(6)
    for contacts in (2, 9, 30):
        N = _normals(rng, 1, 12, contacts)
        arrays = UnitGradients.of(N)
        C, V, count = arrays.columns, arrays.values[0], arrays.count
        plan = plan_of(C, count, contacts, 24)
        for _ in range(20):
            d = rng.normal(size=24)
            q = np.empty(contacts)
            rest = np.empty(24)
            pushes = np.zeros(contacts, bool)
            one_by_one(plan, C, V, count, pushes, d, q, rest)
            assert q.min() >= 0.0 and np.all(q[~pushes] == 0.0)
            assert np.allclose(d - rest, q @ N[0], atol=1e-12)
            assert np.linalg.norm(rest) == pytest.approx(nnls(N[0].T, d)[1], abs=1e-8)


def test_the_least_change_of_a_velocity_keeps_walls_apart():
    """Two walls at an angle drive a point: both of them, or one where the other recedes."""
    least_change = python_entry(_least_change)
    v = np.empty(2)
    q = np.empty(2)
    turned = np.array([[1.0, 0.0], [0.6, 0.8]])
    arrays = UnitGradients.of(turned[None])
    C, V, count = arrays.columns, arrays.values[0], arrays.count
    given = python_entry(arrange)(C, count, 2, 2), C, V, count
    least_change(*given, np.array([-1.0, -1.0]), np.array([-3.0, 0.0]), v, q)
    assert np.allclose(v, [1.0, 0.5], atol=1e-8)
    assert np.allclose(v, np.array([-3.0, 0.0]) + q @ turned, atol=1e-8) and q.min() > 0.0
    least_change(*given, np.array([-1.0, 5.0]), np.array([0.2, -3.0]), v, q)
    assert np.allclose(v, [1.0, -3.0], atol=1e-8) and np.allclose(q, [0.8, 0.0], atol=1e-8)


@pytest.mark.parametrize("strength", [1.0, 1e4, 1e8])
def test_the_least_change_is_right_under_a_strong_drift(strength):
    """A point between a wall that comes with 0.5 and one that recedes with 0.7 is driven at the
    first one: it moves with it, however strong the drift."""
    slab = UnitGradients.of(np.array([[[1.0], [-1.0]]]))
    C, V, count = slab.columns, slab.values[0], slab.count
    plan = python_entry(arrange)(C, count, 2, 1)
    v = np.empty(1)
    q = np.empty(2)
    rates = np.array([0.5, 0.7])
    f = np.array([-strength - 1.0])
    python_entry(_least_change)(plan, C, V, count, rates, f, v, q)
    assert v[0] == pytest.approx(-0.5, abs=1e-14 * strength + 1e-9)
    assert q == pytest.approx([strength + 0.5, 0.0], rel=1e-9)
