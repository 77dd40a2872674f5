"""Growth of one step: against derivatives known in closed form, and never above its bound."""

import numpy as np
import pytest

import nsbench
from nsbench import Affine, Case, Complementarity, Distance
from nsbench.studies.fan.one_step_stability import _stretch_of_sweep, measure_growth
from nsbench.studies.fan.study import describe_growth

H = 0.01
A = np.array([[0.0, 2.0], [-1.0, 0.0]])


def case_of(drift, constraints, x0) -> Case:
    return Case("own", Complementarity(drift, constraints), np.array(x0), np.linspace(0.0, 0.2, 5))


def constant_drift(force):
    return lambda xp: lambda t, x: np.array(force) + 0.0 * x


def test_a_free_step_grows_by_the_norm_of_its_matrix():
    far = Affine(np.array([[0.0, 1.0]]), np.array([9.0]))
    case = case_of(lambda xp: lambda t, x: xp.stack([2.0 * x[1], -x[0]]), (far,), [1.0, 0.5])
    found = measure_growth(case, "pbd", H, 3, 2)
    assert found.growth == pytest.approx(np.linalg.norm(np.eye(2) + H * A, 2), abs=1e-8)
    assert found.lipschitz == pytest.approx(2.0, abs=1e-6) and found.states == 5
    assert found.bound == pytest.approx(1.0 + 2.0 * H, abs=1e-8)
    assert found.constant(found.bound) == pytest.approx(1.0, abs=1e-6)


def test_a_wall_does_not_pull_apart():
    wall = Affine(np.array([[0.0, 1.0]]), np.zeros(1))
    case = case_of(constant_drift([1.0, -1.0]), (wall,), [0.0, 0.0])
    found = measure_growth(case, "pbd", H, 3, 2)
    assert found.growth == pytest.approx(1.0, abs=1e-8) and found.bound == 1.0
    assert found.lipschitz == 0.0 and found.constant(found.growth) is None


@pytest.mark.long
def test_a_projection_of_two_discs_stretches_their_tangential_distance():
    """Discs pressed together by 2 h: tangential distances grow by 2 / (2 - 2 h)."""
    force = [1.0, 0.0, -1.0, 0.0]
    case = case_of(constant_drift(force), (Distance(d=2.0),), [-1.0, 0.0, 1.0, 0.0])
    found = measure_growth(case, "pbd", H, 3, 0)
    assert found.growth == pytest.approx(2.0 / (2.0 - 2.0 * H), abs=1e-7)
    assert found.growth < found.bound < 1.03


def test_projections_without_a_common_disc_act_side_by_side():
    """Two pairs far apart are one layer, three discs in a row two."""
    apart = np.array([[0.0, 0.0], [1.9, 0.0], [9.0, 0.0], [10.9, 0.0]])
    assert _stretch_of_sweep(apart, [(0, 1), (2, 3)], 2.0, 0.0) == pytest.approx(2.0 / 1.9)
    # the first projection moves the middle disc by 0.05: the second overlap is 0.15
    expected = 2.0 / 1.9 * 2.0 / 1.85
    for pairs in ([(0, 1), (1, 2)], [(1, 2), (0, 1)]):
        row = np.array([[0.0, 0.0], [1.9, 0.0], [3.8, 0.0]])
        assert _stretch_of_sweep(row, pairs, 2.0, 0.0) == pytest.approx(expected)


def test_a_contact_that_closes_within_the_ball_counts():
    near = np.array([[0.0, 0.0], [2.1, 0.0]])
    assert _stretch_of_sweep(near, [(0, 1)], 2.0, 0.05) == 1.0
    expected = 2.0 / (2.1 - np.sqrt(2.0) * 0.1)
    assert _stretch_of_sweep(near.copy(), [(0, 1)], 2.0, 0.1) == pytest.approx(expected)
    assert _stretch_of_sweep(near.copy(), [(0, 1)], 2.0, 3.0) == np.inf


@pytest.mark.long
def test_constants_settle_as_the_step_shrinks():
    constants = [describe_growth(nsbench.get_case("hex", n=7), "pbd", d, False) for d in (16, 64)]
    assert constants[0]["C"] == pytest.approx(constants[1]["C"], abs=0.01)
    assert all(c["growth"] <= c["growth_bound"] for c in constants)


@pytest.mark.long
def test_a_growth_above_its_bound_stops_the_study(monkeypatch):
    from nsbench.studies.fan import one_step_stability, study

    monkeypatch.setattr(one_step_stability, "_stretch_of_sweep", lambda *args: 0.5)
    with pytest.raises(ArithmeticError, match="by at most"):
        study.describe_growth(nsbench.get_case("hex", n=7), "pbd", 16, False)
