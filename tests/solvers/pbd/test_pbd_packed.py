"""The loop that stores particles by cells gives the bits of the loop that lists all constraints,
whatever the scene."""

import numpy as np
import pytest
from test_pbd import box_of_discs, crowd

import nsbench
from nsbench import Affine, Case, Complementarity, Distance
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.dynamics.contacts.kernels import impulse_records
from nsbench.dynamics.contacts.kernels.impulse_records import Contacts, cumulate
from nsbench.solvers.pbd import method
from nsbench.solvers.pbd.kernels.cell_search import _cell_geometry

ORDERS = ("sorted", "reverse", "random", "cell", "coloured")


def whirl(xp):
    def f(t, x):
        return xp.cos(3.0 * t) * x[::-1] - x

    return f


def scene(dim, seed, radii=False, moving=False):
    """Balls that overlap at the start, between walls across single coordinates and one that cuts
    the corner."""
    rng = np.random.default_rng(seed)
    n = 100
    size = {1: 150.0, 2: 18.0, 3: 8.0}[dim]
    eye = np.eye(n * dim)
    corner = np.kron(np.eye(n), np.ones((1, dim)))

    def rising(xp):
        def b(t):
            return xp.full(n * dim, -1.0 - 0.5 * t)

        return b

    floor = Affine(eye, rising if moving else np.full(n * dim, -1.0))
    family = Distance(radii=rng.uniform(0.6, 1.2, n), dim=dim) if radii else Distance(2.0, dim=dim)
    families = (
        floor,
        family,
        Affine(-eye, np.full(n * dim, size - 1.0)),
        Affine(-corner, np.full(n, 0.9 * size * dim)),
    )
    x0 = rng.uniform(0.0, size, n * dim)
    return Case(
        "balls", Complementarity(whirl, families), x0, np.linspace(0.0, 0.4, 3), start="keep"
    )


def both(case, spec, h, monkeypatch):
    packed = nsbench.solve(case, spec, h=h)
    with monkeypatch.context() as m:
        m.setattr(method, "is_cell_scene", lambda scene: False)
        return packed, nsbench.solve(case, spec, h=h)


@pytest.mark.long
@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("kind", ["plane", "line", "space", "radii", "moving"])
def test_same_bits_as_over_all_constraints(order, kind, monkeypatch):
    case = scene({"line": 1, "space": 3}.get(kind, 2), 1, kind == "radii", kind == "moving")
    assert method.is_cell_scene(ConstraintSet(case.problem, case.n))
    for sweeps, reach in ((1, 0.5), (2, 0.05)):
        a, b = both(case, f"pbd[order={order},sweeps={sweeps},reach={reach}]", 0.02, monkeypatch)
        assert np.array_equal(a.x, b.x) and np.array_equal(a.reaction, b.reaction)
        assert a.contacts == b.contacts and np.array_equal(a.impulse, b.impulse)
        assert a.status == b.status and a.stats["projections"] == b.stats["projections"]


def test_coincident_centres_and_an_end_in_nan_are_the_same(monkeypatch):
    base = crowd(30, 12.0, 1, True)
    x0 = base.x0.copy()
    x0[2:4] = x0[0:2]  # the first pair of the sweep: nothing parts them before

    def ends(xp):
        def f(t, x):
            return xp.sqrt(0.2 - t) * x

        return f

    for case in (
        base.replace(x0=x0),
        base.replace(problem=Complementarity(ends, base.problem.constraints)),
    ):
        with np.errstate(invalid="ignore"):
            a, b = both(case, "pbd", 0.05, monkeypatch)
        assert a.status == b.status and not a.status.ok
        assert np.array_equal(a.x, b.x, equal_nan=True) and np.array_equal(
            a.impulse, b.impulse, equal_nan=True
        )


@pytest.mark.long
def test_lists_that_get_too_long_hand_the_run_over(monkeypatch):
    case = box_of_discs(1600, 0.8, "overlapping").replace(t=np.linspace(0.0, 0.03, 2))
    calls = []
    listed = method.PBD._listed
    with monkeypatch.context() as m:
        m.setattr(method.PBD, "_listed", lambda *args: (calls.append(1), listed(*args))[1])
        a = nsbench.solve(case, "pbd[reach=0.05]", h=0.01)
    assert calls, "the fast loop has given up"
    b = nsbench.solve(case, "pbd[reach=1e9]", h=0.01)
    assert (
        np.array_equal(a.x, b.x)
        and np.array_equal(a.impulse, b.impulse)
        and a.contacts == b.contacts
    )


def test_lists_that_outgrow_their_arrays_give_the_same_bits(monkeypatch):
    case = box_of_discs(1000, 0.8, "overlapping").replace(t=np.linspace(0.0, 0.06, 3))
    a, b = both(case, "pbd[order=coloured,reach=5]", 0.02, monkeypatch)
    assert np.array_equal(a.x, b.x) and np.array_equal(a.impulse, b.impulse)
    assert a.stats["contacts_peak"] > 8 * 1000 + 64, "longer than the first arrays"


def test_many_contacts_are_kept_as_an_array_that_reads_like_the_tuple():
    rng = np.random.default_rng(2)
    ids = np.column_stack(
        (
            rng.integers(0, 3, 400),
            rng.integers(0, 2, 400),
            rng.integers(0, 9, 400),
            rng.integers(-1, 9, 400),
        )
    )
    ids = np.unique(ids, axis=0)[rng.permutation(len(np.unique(ids, axis=0)))]
    values = rng.random(len(ids))
    names, impulse = cumulate(ids, values, 3)
    want = sorted(
        {(f, i) if j < 0 else (f, i, j) for _, f, i, j in ids.tolist()}, key=lambda c: (*c, -1)[:3]
    )
    assert list(names) == want
    one = want.index((ids[0, 1], ids[0, 2]) if ids[0, 3] < 0 else tuple(ids[0, 1:].tolist()))
    same = (ids[:, 1:] == ids[0, 1:]).all(axis=1)
    assert np.isclose(impulse[-1, one], values[same].sum())
    array = Contacts(np.array([(*c, -1)[:3] for c in want], np.int32))
    assert (
        array == names and names == tuple(array) and len(array) == len(want) and array[2] == want[2]
    )
    assert (
        array.index(want[5]) == 5
        and hash(array) == hash(tuple(want))
        and array != names[1:]
        and array[1:] == names[1:]
    )


@pytest.mark.parametrize("largest", [40, 10**6, 2**31 - 1])
def test_records_are_summed_whatever_their_indices(largest):
    rng = np.random.default_rng(5)
    ids = np.sort(rng.integers(0, 40, (3000, 4)), axis=1)[:, [0, 1, 2, 3]]
    ids[:, 1] %= 3
    ids[rng.integers(0, 3000, 500), 3] = -1
    ids[0, 3] = largest
    values = rng.uniform(size=3000)
    names, impulse = cumulate(ids, values, 40)
    want, column = np.unique(ids[:, 1:], axis=0, return_inverse=True)
    assert [(*name, -1)[:3] for name in names] == [tuple(w) for w in want.tolist()]
    total = np.zeros(impulse.shape)
    np.add.at(total, (ids[:, 0], column.ravel()), values)
    assert np.allclose(impulse, np.cumsum(total, axis=0))


def test_a_run_with_many_contacts_is_returned_like_one_with_few(monkeypatch):
    case = nsbench.get_case("discs", n=10)
    few = nsbench.solve(case, "pbd", h=0.01)
    monkeypatch.setattr(impulse_records, "MANY", 0)
    many = nsbench.solve(case, "pbd", h=0.01)
    assert isinstance(many.contacts, Contacts) and many.contacts == few.contacts
    assert np.array_equal(many.impulse, few.impulse)


def test_walls_far_away_at_the_start_are_met():
    """Rows of A are looked for in a list that reaches far, made anew when particles have gone that
    far together."""

    def fly(xp):
        def f(t, x):
            return xp.array([1.0, 0.0, 0.0, 1.0]) + 0.0 * x

        return f

    families = (Distance(2.0), Affine(-np.eye(4), np.full(4, 9.0)))
    case = Case(
        "fly",
        Complementarity(fly, families),
        np.array([0.0, 0.0, -5.0, 0.0]),
        np.linspace(0.0, 12.0, 3),
    )
    traj = nsbench.solve(case, "pbd[reach=0.05]", h=0.01)
    assert np.allclose(traj.x[-1], [9.0, 0.0, -5.0, 9.0], atol=1e-12)
    assert traj.stats["rebuilds"] > 300 and np.allclose(traj.impulse[-1], 3.0)


def test_a_free_collapse_needs_few_lists():
    traj = nsbench.solve(nsbench.get_case("discs", n=200), "pbd", h=0.01)
    assert traj.stats["rebuilds"] <= 1.5 * traj.stats["steps"], traj.stats


@pytest.mark.parametrize("centre", [(0.3, 0.4), (0.2, 0.4, 0.4)])
def test_two_particles_are_parted_along_the_line_of_their_centres(centre):
    """One at 0, one at a centre c within d = 1: they end at  c / 2 -+ c / (2 |c|)."""
    c = np.array(centre)
    case = Case(
        "pair",
        Complementarity(lambda xp: lambda t, x: 0.0 * x, (Distance(1.0, dim=c.size),)),
        np.concatenate((np.full(c.size, 5.0), 0.0 * c, c)),
        np.linspace(0.0, 1.0, 3),
        start="keep",
    )
    ends = np.split(nsbench.solve(case, "pbd", h=0.1).x[-1], 3)
    half = 0.5 * c / np.linalg.norm(c)
    for got, want in zip(ends, (np.full(c.size, 5.0), 0.5 * c - half, 0.5 * c + half), strict=True):
        np.testing.assert_allclose(got, want, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("extents", [(9.5, 2.5), (2.5, 9.5, 0.5), (100.0, 0.0)])
def test_cells_along_an_axis_are_as_many_as_its_extent_needs(extents):
    """At least as wide as the reach, and of an axis at most the root of four times the discs."""
    x = np.zeros((40, len(extents)))
    x[-1] = extents
    x[7] = np.array(extents) / 3
    lo, width, num = _cell_geometry.py_func((x - 2.0).ravel(), len(extents), 1.0, 40)
    most = np.ceil(160 ** (1 / len(extents)))
    for c, extent in enumerate(extents):
        assert (lo[c], width[c]) == (-2.0, max(1.0, extent / most))
        assert num[c] == int(extent / width[c]) + 1
    assert (num[len(extents) :] == 1).all()
