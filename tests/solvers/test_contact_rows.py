"""Contacts as the error bars read them: gaps, gradients by entries, projection on their cone."""

import numpy as np
import pytest
from scipy.sparse import csr_array

import nsbench
from nsbench import Affine, Complementarity, Distance, Smooth
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.error_bars.contact_rows import ContactRows
from nsbench.error_bars.drift import Drift
from nsbench.error_bars.kernels.gram import gram_multipliers
from nsbench.error_bars.kernels.unit_gradients import first_closing, gaps_and_gradients
from nsbench.error_bars.shadow import Shadow
from nsbench.error_bars.unit_gradients import DAMPING, UnitGradients


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


def test_rows_that_are_taken_are_those_of_all():
    _, _, rows = _mixed_rows()
    rng = np.random.default_rng(1)
    t = rng.uniform(size=2)
    X = rng.normal(size=(2, 6))
    gaps, N = rows.gaps_and_gradients(t, X)
    for index in ([1, 0], [3, 5], [len(rows.ids) - 1], list(range(rows.m))):
        some = rows.take(np.array(index))
        assert some.ids == tuple(rows.ids[k] for k in index)
        assert some.is_straight == (max(index) < 2)
        found, part = some.gaps_and_gradients(t, X)
        assert np.array_equal(found, gaps[:, index])
        assert np.array_equal(
            np.broadcast_to(part.dense(), (2, len(index), 6)), N.dense()[:, index]
        )


def test_a_row_that_lists_a_coordinate_twice_is_its_sum():
    twice = csr_array(([1.0, 3.0, 3.0], [0, 0, 1], [0, 3]), shape=(1, 2))
    scene = ConstraintSet(Complementarity(_at_rest, (Affine(twice, b=np.zeros(1)),)), 2)
    rows = ContactRows(scene, [(0, 0)])
    gaps, N = rows.gaps_and_gradients(np.zeros(1), np.array([[5.0, 10.0]]))
    assert gaps[0, 0] == pytest.approx(10.0)
    assert np.allclose(N.dense()[0, 0], [0.8, 0.6])
    assert np.allclose(N.multipliers(np.ones((1, 1))), 1.0, rtol=1e-9)


def test_the_first_gap_that_closes_on_a_cubic_is_found():
    """x = 1 - 2 w and y = 1 - 8 w^3 reach the walls x >= 0.25 and y >= 0.5 at w = 0.375 and at the
    cube root of 1/16."""
    walls = Complementarity(_at_rest, (Affine(np.diag([4.0, 1.0]), b=np.array([-1.0, -0.5])),))
    scene = ConstraintSet(walls, 2)
    rows = ContactRows(scene, [(0, 0), (0, 1)])
    powers = np.array([[1.0, 1.0], [-2.0, 0.0], [0.0, 0.0], [0.0, -8.0]])
    looks = np.arange(1, 17) / 16.0
    assert rows.can_be_searched
    assert rows.first_closing(powers, looks, 0.0, 45) == pytest.approx(0.375, abs=1e-12)
    only = rows.take(np.array([1]))
    end = only.first_closing(powers, looks, 1e-9, 45)
    assert end == pytest.approx(16.0 ** (-1 / 3), abs=1e-9)
    X = (powers[0] + end * (powers[1] + end * (powers[2] + end * powers[3])))[None]
    assert only.gaps(np.zeros(1), X)[0, 0] < 1e-9
    assert rows.first_closing(powers, looks[:5], 0.0, 45) == np.inf
    assert rows.first_closing(np.nan * powers, looks, 0.0, 45) < looks[0]


def test_no_pair_that_comes_near_is_missed_between_two_listings():
    case = nsbench.get_case("discs[n=30]")
    scene = ConstraintSet(case.problem, case.n)
    shadow = Shadow(scene, Drift(case.problem.drift, case.n))
    rng = np.random.default_rng(2)
    y = np.array(case.x0, float)
    listed = set()
    for _ in range(200):
        y = y + 0.01 * rng.normal(size=case.n)
        rows = shadow.near_rows(y, 0.5)
        listed.add(id(rows))
        assert set(scene.near(y, 0.5).ids) <= set(rows.ids)
    assert 1 < len(listed) < 100
    assert shadow.near_rows(y, 0.01).m < rows.m


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
    for kernel in (first_closing, gaps_and_gradients):
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
