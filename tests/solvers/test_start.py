"""A start that overlaps is put to the nearest feasible point, of few particles and of many, by two
solvers of one problem."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear, root

import nsbench
from nsbench import Affine, Case, Complementarity, Distance, Smooth, solvers
from nsbench.dynamics.contacts.constraint_set import ConstraintSet
from nsbench.qp import projection
from nsbench.solvers.common import initial_state
from nsbench.study.result_contract import contract_violation


def still(xp):
    return lambda t, x: 0.0 * x


def heap(m, share):
    """m discs of diameter 1 thrown into a square of which they would cover `share`."""
    side = np.sqrt(m * np.pi / 4.0 / share)
    x0 = np.random.default_rng(m).uniform(0.0, side, 2 * m)
    problem = Complementarity(still, (Distance(1.0),))
    return Case("heap", problem, x0, np.linspace(0.0, 1.0, 2), start="project"), ConstraintSet(
        problem, 2 * m
    )


@pytest.mark.long
def test_many_discs_are_projected_over_those_near(monkeypatch):
    """800 discs have 319 600 pairs; the way is a combination of pushes of the contacts, none of
    which pulls."""
    case, scene = heap(800, 0.5)
    asked = []

    def solve(row, cols, vals, q, n, guess, plain=projection.least_distance):
        asked.append(len(q))
        return plain(row, cols, vals, q, n, guess)

    monkeypatch.setattr(initial_state, "least_distance", solve)
    x = initial_state.initial_state(case, scene)
    assert scene.max_violation(0.0, x) < 1e-12 and max(asked) < 4000
    on = scene.near(x, 1e-11)
    G = scene.gradients(0.0, x, on)
    pushes = lsq_linear(G.T, x - case.x0, (0.0, np.inf), tol=1e-14, lsmr_tol=1e-14)
    assert np.abs(G.T @ pushes.x - (x - case.x0)).max() < 1e-7 < 0.5 < np.abs(x - case.x0).max()


@pytest.mark.parametrize("entries", [0, 10**9])
def test_pairs_left_out_change_nothing(entries, monkeypatch):
    monkeypatch.setattr(projection, "DENSE", entries)
    case, scene = heap(90, 2.0)
    found = initial_state.initial_state(case, scene)
    monkeypatch.setattr(projection, "DENSE", 10**9)
    monkeypatch.setattr(
        scene, "near", lambda x, reach, t=0.0: ConstraintSet.near(scene, x, np.inf, t)
    )
    assert initial_state.initial_state(case, scene) == pytest.approx(found, abs=1e-10)


def test_lines_left_out_at_first_are_obeyed():
    """One problem of all the lines against SciPy's answer; of 4005 lines a few dozen are violated
    at first."""
    case, scene = heap(90, 1.1)
    lines = initial_state.LinearisedConstraints(case, scene, 0.0, case.x0, np.inf)
    d = lines.nearest(np.zeros(180), {})
    G = scene.dense_gradients(0.0, case.x0, lines.near)
    exact = projection.least_distance(
        *scene.gradient_entries(0.0, case.x0, lines.near), lines.g, 180, np.zeros(len(lines.g))
    )[0]
    assert (lines.g + G @ d).min() > -1e-12 and d == pytest.approx(exact, abs=1e-11)


@pytest.mark.parametrize("entries", [0, 10**9])
@pytest.mark.parametrize("unit", [1e-8, 1e8])
def test_the_point_is_the_same_in_any_unit(unit, entries, monkeypatch):
    monkeypatch.setattr(projection, "DENSE", entries)
    case, scene = heap(20, 0.9)
    x = initial_state.initial_state(case, scene)
    problem = Complementarity(still, (Distance(unit),))
    scaled = initial_state.initial_state(
        case.replace(problem=problem, x0=unit * case.x0), ConstraintSet(problem, 40)
    )
    assert scaled == pytest.approx(unit * x, abs=1e-11 * unit)


@pytest.mark.parametrize("entries", [0, 10**9])
def test_walls_without_room_are_told_by_both(monkeypatch, entries):
    monkeypatch.setattr(projection, "DENSE", entries)
    problem = Complementarity(still, (Affine(np.array([[1.0], [-1.0]]), np.array([0.0, -1.0])),))
    case = Case("shut", problem, np.zeros(1), np.linspace(0.0, 1.0, 2), start="project")
    with pytest.raises(initial_state.InfeasibleStart, match="leave no point"):
        initial_state.initial_state(case, ConstraintSet(problem, 1))


def test_a_wall_far_away_excuses_nothing_near():
    problem = Complementarity(still, (Affine(np.array([[1.0], [-1.0]]), np.array([0.0, 1e9])),))
    case = Case("far", problem, np.array([-0.5]), np.linspace(0.0, 1.0, 2))
    with pytest.raises(ValueError, match="violates constraint"):
        initial_state.initial_state(case, ConstraintSet(problem, 1))
    assert initial_state.initial_state(
        case.replace(start="project"), ConstraintSet(problem, 1)
    ) == pytest.approx([0.0], abs=1e-12)


def test_a_long_link_excuses_no_overlap():
    problem = Complementarity(still, (Distance(1.0), Distance(1e9, -1, pairs=[[0, 1]])))
    case = Case("linked", problem, np.array([0.0, 0.0, 0.5, 0.0]), np.linspace(0.0, 1.0, 2))
    with pytest.raises(ValueError, match=r"violates constraint \(0, 0, 1\) by 0.5"):
        initial_state.initial_state(case, ConstraintSet(problem, 4))


def test_rounding_at_a_wall_through_the_origin_is_none():
    problem = Complementarity(still, (Affine(np.array([[1.0]]), np.array([0.0])),))
    case = Case("rounded", problem, np.array([0.3 - (0.1 + 0.2)]), np.linspace(0.0, 1.0, 2))
    assert case.x0 <= initial_state.initial_state(case, ConstraintSet(problem, 1)) <= 0.0


@pytest.mark.parametrize("factor", [1e-6, 1.0, 1e6])
def test_the_length_of_rows_is_nothing_to_a_projection(factor):
    rng = np.random.default_rng(5)
    for _ in range(30):
        A = rng.standard_normal((3, 4))
        inside = rng.standard_normal(4)
        x0 = rng.standard_normal(4)
        problem = Complementarity(still, (Affine(factor * A, factor * -(A @ inside)),))
        case = Case("rows", problem, x0, np.linspace(0.0, 1.0, 2), start="project")
        assert (
            A @ (initial_state.initial_state(case, ConstraintSet(problem, 4)) - inside)
        ).min() > -1e-10


@pytest.mark.parametrize("d", [1e-9, 1e-8, 1.0])
@pytest.mark.parametrize("at", [0.0, 0.5, 1.0])
def test_an_overlap_is_held_against_the_particles(d, at):
    """Nine hundredths of what the smallest is, wherever they lie, and with a wall out of reach."""
    wall = Affine(np.array([[1.0, 0.0, 0.0, 0.0]]), np.array([1.0]))
    problem = Complementarity(still, (Distance(d), wall))
    case = Case("small", problem, np.array([at, 0.0, at + 0.91 * d, 0.0]), np.linspace(0.0, 1.0, 2))
    with pytest.raises(ValueError, match=r"violates constraint \(0, 0, 1\)"):
        initial_state.initial_state(case, ConstraintSet(problem, 4))
    rounded = case.replace(x0=np.array([at, 0.0, at + d * (1.0 - 1e-10), 0.0]) + np.spacing(at))
    assert np.abs(
        initial_state.initial_state(rounded, ConstraintSet(problem, 4)) - rounded.x0
    ).max() <= 1.01e-10 * d + np.spacing(at)


@pytest.mark.long
@pytest.mark.parametrize("radius", [1e-5, 1.0, 1e4])
@pytest.mark.parametrize("far", [0.0, 1e9])
def test_a_smooth_constraint_is_held_against_what_it_sees(radius, far):
    """x^2 + y^2 >= R^2 from 4/5 of R; a third coordinate that it knows nothing of. Projected, the
    start lies on the circle."""
    disc = Smooth(lambda xp: lambda t, x: xp.array([x[0] ** 2 + x[1] ** 2 - radius**2]))
    problem = Complementarity(still, (disc,))
    case = Case(
        "inside", problem, np.array([0.64 * radius, 0.48 * radius, far]), np.linspace(0.0, 1.0, 2)
    )
    with pytest.raises(ValueError, match="violates constraint"):
        initial_state.initial_state(case, ConstraintSet(problem, 3))
    x = initial_state.initial_state(case.replace(start="project"), ConstraintSet(problem, 3))
    assert x[:2] == pytest.approx([0.8 * radius, 0.6 * radius], rel=1e-7)


@pytest.mark.long
@pytest.mark.parametrize("radius", [1e2, 1e4, 1e6])
def test_a_projection_ends_at_the_rounding_of_its_constraints(radius):
    """On circles from within, on links of the same length that are held far away: the gaps round,
    near the origin."""
    rng = np.random.default_rng(2)
    link = Distance(radius, -1, pairs=[[0, 0]], anchors=np.array([[0.6 * radius, 0.8 * radius]]))
    disc = Smooth(lambda xp: lambda t, x: xp.array([x[0] ** 2 + x[1] ** 2 - radius**2]))
    for _ in range(4):
        for held, x0 in (
            (disc, radius * rng.uniform(-0.6, 0.6, 2)),
            (link, -rng.uniform(0.0, 0.5, 2)),
        ):
            problem = Complementarity(still, (held,))
            case = Case("on", problem, x0, np.linspace(0.0, 1.0, 2), start="project")
            x = initial_state.initial_state(case, ConstraintSet(problem, 2))
            away = np.hypot(*x) if held is disc else np.hypot(*(x - [0.6 * radius, 0.8 * radius]))
            assert away == pytest.approx(radius, rel=1e-14)


def test_a_start_printed_with_ten_digits_is_a_start():
    """Touching discs of 0.1 in a box of 10, a particle on a wall at some hundreds: what they miss
    by is taken away."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        angle = rng.uniform(0.0, 2.0 * np.pi)
        p = rng.uniform(1.0, 9.0, 2)
        discs = Complementarity(still, (Distance(0.1),))
        wall = Complementarity(still, (Affine(np.array([[1.0, 0.0]]), np.array([-50.0 * p[0]])),))
        for problem, x in (
            (discs, [*p, *(p + 0.1 * np.array([np.cos(angle), np.sin(angle)]))]),
            (wall, [50.0 * p[0], 1.0]),
        ):
            x0 = np.array([float(f"{v:.10g}") for v in x])
            case = Case("printed", problem, x0, np.linspace(0.0, 1.0, 2))
            scene = ConstraintSet(problem, x0.size)
            found = initial_state.initial_state(case, scene)
            assert np.abs(found - x0).max() <= scene.max_violation(0.0, x0) < 1e-7
            assert scene.max_violation(0.0, found) <= 1e-14 * np.abs(x0).max() + 1e-13


@pytest.mark.long
@pytest.mark.parametrize("policy", ("error", "project"))
def test_no_method_makes_a_push_of_the_digits_that_a_start_was_not_printed_with(policy):
    """A particle that rests on a wall at 1000 1/3, from 1000.333333, under a force: impulses of PBD
    are of first order."""
    problem = Complementarity(
        lambda xp: lambda t, x: xp.array([-1.0 - xp.sin(3.0 * t)]),
        (Affine(np.array([[1.0]]), np.array([-(1000.0 + 1.0 / 3.0)])),),
    )
    case = Case("printed", problem, np.array([1000.333333]), np.linspace(0.0, 1.0, 5), start=policy)
    exact = case.t + (1.0 - np.cos(3.0 * case.t)) / 3.0
    for spec, miss in (("event_driven", 1e-11), ("catching_up", 1e-6), ("pbd", 1e-6)):
        run = solvers.solve(case, spec, **({"h": miss} if miss == 1e-6 else {"tol": 1e-12}))
        assert run.status.ok and np.abs(run.impulse[:, 0] - exact).max() < 0.6 * miss, spec


@pytest.mark.parametrize("miss", (0.0, 5e-10, 5e-9, 3e-7, 9e-7))
def test_a_run_may_begin_at_a_start_that_misses_by_little_or_where_it_is_projected_to(miss):
    problem = Complementarity(
        lambda xp: lambda t, x: xp.array([-1.0 + 0.0 * t]),
        (Affine(np.eye(1), np.array([-1000.0])),),
    )
    case = Case(
        "wall", problem, np.array([1000.0 - miss]), np.linspace(0.0, 1.0, 5), start="project"
    )
    run = solvers.solve(case, "pbd", h=0.01)
    begins = lambda x: replace(run, x=np.concatenate([[[x]], run.x[1:]]))
    assert not contract_violation(case, begins(1000.0)) and not contract_violation(
        case, begins(1000.0 - miss)
    )
    assert "begins with" in contract_violation(
        case, begins(1000.0 + 1e-4 if miss else 1000.0 + 1e-8)
    )


@pytest.mark.parametrize("angle", (1e-4, 1e-5))
def test_a_start_is_not_moved_much_farther_than_it_misses(angle):
    """In a narrow wedge, 9e-10 within a wall: the nearest point that misses nothing is 1 / angle
    times as far, and meant only where it is asked for."""
    walls = Affine(np.array([[1.0, 0.0], [-1.0, angle]]), np.array([0.0, -angle - 9e-10]))
    problem = Complementarity(lambda xp: lambda t, x: xp.array([0.0 * t, 1.0 + 0.0 * t]), (walls,))
    case = Case("wedge", problem, np.array([0.0, 1.0]), np.linspace(0.0, 1.0, 3))
    with pytest.raises(ValueError, match="much farther away"):
        initial_state.initial_state(case, ConstraintSet(problem, 2))
    meant = initial_state.initial_state(case.replace(start="project"), ConstraintSet(problem, 2))
    assert meant == pytest.approx([0.0, 1.0 + 9e-10 / angle], abs=1e-9)


def test_a_start_printed_beside_the_end_of_a_wedge_is_moved_by_no_more_than_its_digits():
    """Half a degree wide, from x = 1/3 on: the start lies 3.3e-11 before it, and 2.9e-13 within a
    wall."""
    a = np.radians(0.5)
    walls = Affine(
        np.array([[0.0, 1.0], [np.sin(a), -np.cos(a)]]), np.array([0.0, -np.sin(a) / 3.0])
    )
    problem = Complementarity(lambda xp: lambda t, x: xp.array([1.0 + 0.0 * t, 0.0 * t]), (walls,))
    case = Case("printed", problem, np.array([0.3333333333, 0.0]), np.linspace(0.0, 1.0, 3))
    assert initial_state.initial_state(case, ConstraintSet(problem, 2)) == pytest.approx(
        [1.0 / 3.0, 0.0], abs=1e-12
    )


@pytest.mark.long
@pytest.mark.parametrize(
    "spec, asked",
    (("catching_up", {"h": 0.01}), ("theta", {"h": 0.01}), ("event_driven", {"tol": 1e-10})),
)
def test_a_long_row_that_misses_everywhere_is_pulled_apart_to_its_end(spec, asked):
    """250 rods, each 5e-10 too near to the one before: all are pushed by a tenth, and the wall
    carries 25."""
    many = 250
    rows = Affine(np.eye(many) - np.eye(many, k=-1), np.concatenate([[0.0], -np.ones(many - 1)]))
    problem = Complementarity(lambda xp: lambda t, x: -0.1 * xp.ones_like(x), (rows,))
    case = Case("rods", problem, np.arange(many) * (1.0 - 5e-10), np.linspace(0.0, 1.0, 3))
    assert solvers.solve(case, spec, **asked).impulse[-1].max() == pytest.approx(25.0, abs=1e-9)


def test_a_study_in_python_refuses_an_infeasible_start_before_its_runs(monkeypatch):
    case = replace(heap(2, 0.1)[0], start="error", x0=np.array([0.0, 0.0, 0.5, 0.0]))
    monkeypatch.setattr("nsbench.study.run_batch", lambda specs: pytest.fail("ran"))
    with pytest.raises(ValueError, match="the start of heap violates constraint .* by 0.5"):
        nsbench.run(case)


def test_a_projected_start_is_the_nearest_point_where_the_steps_to_it_shrink_slowly():
    """Newton's method for x = x0 + sum mu grad g, g = 0: each step of the projection is 0.95 times
    the last one, so that small steps alone leave twenty of them."""
    case = nsbench.get_case("overlap_start", meaning="project")
    start = nsbench.solve(case, "event_driven").x[0]
    i, j = np.triu_indices(case.n // 2, 1)
    apart = np.linalg.norm(start.reshape(-1, 2)[i] - start.reshape(-1, 2)[j], axis=1)
    closed = apart < 2.0 + 1e-9
    i = i[closed]
    j = j[closed]

    def conditions(v):
        x = v[: case.n].reshape(-1, 2)
        way = x[i] - x[j]
        length = np.linalg.norm(way, axis=1)
        push = (v[case.n :] / length)[:, None] * way
        off = x - case.x0.reshape(-1, 2)
        np.subtract.at(off, i, push)
        np.add.at(off, j, push)
        return np.concatenate([off.ravel(), length - 2.0])

    found = root(conditions, np.concatenate([start, np.full(len(i), 0.5)]), tol=1e-15).x
    assert np.abs(conditions(found)).max() < 1e-14
    np.testing.assert_allclose(start, found[: case.n], rtol=0.0, atol=3e-13)
