"""Where the solution is not unique, runs are measured by their distance to the set of all
solutions."""

import itertools

import numpy as np
import pytest
from nsbench.cases import repulsive, two_surfaces

from nsbench import Case, Filippov, errors, get_case, solve
from nsbench.reference import reference
from nsbench.trajectory import Trajectory

GENERIC = "two_surfaces[kind=generic]"


def test_the_distance_to_all_ways_off_a_line_is_found_by_search():
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 2.0, 21)
    taus = np.append(np.linspace(0.0, 2.0, 4001), np.inf)
    for _ in range(20):
        y = rng.choice([-1, 1]) * np.maximum(t - rng.uniform(0, 2.5), 0) + 0.1 * rng.normal(size=21)
        ways = np.maximum(t - taus[:, None], 0.0)
        best = min(np.abs(y - s * ways).max(axis=1).min() for s in (1, -1))
        assert repulsive.distance(t, np.stack([t, y], 1)) == pytest.approx(best, abs=6e-4)


def test_every_way_off_the_line_is_a_solution():
    t = np.linspace(0.0, 2.0, 41)
    for tau, side in itertools.product((0.0, 0.33, 1.0, 5.0), (1, -1)):
        x = np.stack([t, side * np.maximum(t - tau, 0)], 1)
        assert repulsive.distance(t, x) < 1e-14
        assert repulsive.distance(t, x + np.array([1e-3, 0.0])) == pytest.approx(1e-3)
    late = np.stack(
        [t, 2.0 * np.maximum(t - 1.0, 0)], 1
    )  # leaves at twice the speed: tau = 1/2 is nearest
    assert repulsive.distance(t, late) == pytest.approx(0.5, abs=1e-9)


def test_velocities_along_the_intersection_are_those_of_convex_combinations():
    rng = np.random.default_rng(1)
    fields = np.array(list(two_surfaces.CORNERS.values()))
    seen = []
    for w in rng.dirichlet(np.ones(4), 20_000):
        if np.abs((w @ fields)[:2]).max() < 0.05:
            seen.append((w @ fields)[2])
    assert two_surfaces.LOW - 0.1 < min(seen) < two_surfaces.LOW + 0.3
    assert two_surfaces.HIGH - 0.3 < max(seen) < two_surfaces.HIGH + 0.1


def test_the_distance_to_all_curves_with_bounded_slopes_is_found_by_linear_programming():
    from scipy.optimize import linprog

    case = get_case(GENERIC)
    rng = np.random.default_rng(2)
    t = case.t
    low = two_surfaces.LOW
    high = two_surfaces.HIGH
    for _ in range(5):
        z = (
            np.minimum(t, 0.5)
            + rng.uniform(0, 3) * np.maximum(t - 0.5, 0)
            + 0.2 * rng.normal(size=len(t)) * (t > 0)
        )
        late = np.diff(np.maximum(t - 0.5, 0.0))
        early = np.diff(np.minimum(t, 0.5))
        n = len(t)
        up = np.hstack([np.tril(np.ones((n - 1, n - 1))), -np.ones((n - 1, 1))])
        down = np.hstack([-np.tril(np.ones((n - 1, n - 1))), -np.ones((n - 1, 1))])
        found = linprog(
            np.append(np.zeros(n - 1), 1.0),
            np.vstack([up, down]),
            np.concatenate([z[1:], -z[1:]]),
            bounds=[*zip(early + low * late, early + high * late, strict=True), (0, None)],
        )
        assert found.status == 0
        x = np.stack([np.maximum(0.5 - t, 0), np.maximum(0.5 - t, 0), z], 1)
        assert two_surfaces.distance(t, x) == pytest.approx(found.fun, abs=1e-9)


@pytest.mark.long
@pytest.mark.survives("repulsive")
@pytest.mark.parametrize("name, bound", [("repulsive", 1e-12), (GENERIC, 3e-3)])
@pytest.mark.parametrize("spec", ["euler", "euler[implicit=true]"])
def test_methods_that_pick_one_solution_are_near_the_set(name, bound, spec):
    case = get_case(name)
    traj = solve(case, spec, h=1e-3)
    e = errors(case, traj)
    assert traj.status.ok and e["set_distance"] <= bound and e["residual"] < 1e-9
    assert np.isnan(e["state_sup"]) and np.isnan(e["impulse"]) and e["reference"] == "none"


@pytest.mark.long
def test_another_method_may_pick_another_velocity():
    case = get_case(GENERIC)
    chatter = solve(case, "euler", h=1e-3)
    held = solve(case, "event_driven")
    assert held.status.ok and errors(case, held)["set_distance"] < 1e-12
    assert np.abs(chatter.x[-1] - held.x[-1]).max() > 0.1, (
        "a reference trajectory would have called one of them wrong"
    )


def test_what_leaves_the_set_is_measured():
    case = get_case(GENERIC)
    traj = solve(case, "event_driven")
    traj.x[:, 2] += 0.25 * case.t
    assert errors(case, traj)["set_distance"] > 0.05
    traj.x[:, 2] += 3.0 * case.t
    e = errors(case, traj)
    assert e["set_distance"] > 1.0 and e["residual"] > 1.0


@pytest.mark.survives("repulsive")
def test_following_events_refuses_to_pick():
    traj = solve("repulsive", "event_driven")
    assert traj.status.code == "degenerate" and "not unique" in str(traj.status)


@pytest.mark.survives("repulsive")
def test_a_reference_is_forbidden_there():
    case = get_case("repulsive")
    assert reference(case.replace(exact=lambda t: np.stack([t, t], 1))) is None
    with pytest.raises(ValueError, match="unique=False"):
        case.replace(unique=True)


def up(xp):
    return lambda t, x: xp.array([1.0, 1.0])


def down(xp):
    return lambda t, x: xp.array([1.0, -1.0])


@pytest.mark.survives("repulsive")
def test_a_solution_that_is_not_unique_is_judged_by_the_inclusion_alone():
    t = np.linspace(0, 1, 11)
    problem = Filippov({(1,): up, (-1,): down}, lambda xp: lambda t, x: x[1:])
    case = Case("repulsive", problem, np.zeros(2), t, unique=False)
    none = np.empty((11, 0))
    late = np.maximum(t - 0.5, 0.0)
    for height, theta in ((t, t), (-t, 0 * t), (0 * t, 0.5 * t), (late, 0.5 * (t + late))):
        e = errors(
            case, Trajectory(t, np.stack([t, height], 1), ((0, 0),), theta[:, None], none)
        )
        assert (
            e["reference"] == "none"
            and e["multipliers_unique"] is None
            and np.isnan(e["state_sup"])
        )
        assert e["residual"] < 1e-12 and e["complementarity"] < 1e-12
    e = errors(case, Trajectory(t, np.stack([t, 2 * t], 1), ((0, 0),), t[:, None], none))
    assert e["residual"] == pytest.approx(1.0)
    e = errors(
        case, Trajectory(t, np.stack([t, t / 2], 1), ((0, 0),), 0.75 * t[:, None], none)
    )
    assert e["complementarity"] > 0.1  # leaves at half the speed: a mixture away from the surface
