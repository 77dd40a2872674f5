"""PBD with accumulated multipliers: that of PBD from zero, right at rest, taken back when open."""

import numpy as np
import pytest

import nsbench
from nsbench.studies.multipliers.equal_cost import KEPT, ZERO
from nsbench.studies.multipliers.figures import settling_figure
from nsbench.studies.multipliers.settling import arrives_at, fit_growth, follow_column, follow_pile
from nsbench.studies.multipliers.warm_start import accumulate, run_variant


@pytest.mark.parametrize("order", ["sorted", "reverse", "random,seed=3"])
@pytest.mark.parametrize("key", ["rods_wall[n=4]", "discs[n=8,seed=0]", "chain[growth=1.0]"])
def test_from_zero_and_without_taking_back_it_is_pbd(key, order):
    case = nsbench.get_case(key)
    h = float(np.diff(case.t).min()) / 8
    method = f"pbd[order={order},sweeps=3]"
    plain = nsbench.solve(case, method, h=h)
    same = accumulate(case, method, h, is_kept=False, is_taken_back=False)
    assert np.abs(plain.x - same.x).max() < 1e-12
    assert np.abs(plain.reaction - same.reaction).max() < 1e-12
    assert plain.contacts == same.contacts
    assert np.abs(plain.impulse - same.impulse).max() < 1e-12


def test_sums_of_corrections_are_clamped_where_several_sweeps_open_a_contact_again():
    case = nsbench.get_case("discs[n=8,seed=0]")
    runs = [accumulate(case, "pbd[sweeps=3]", 0.01, False, back) for back in (False, True)]
    assert np.abs(runs[0].x - runs[1].x).max() > 1e-4


def test_a_column_at_rest_keeps_no_overlap():
    case = nsbench.get_case("stack", n=5)
    h = 1e-3
    case = case.replace(t=h * np.arange(301))
    cold, warm = (run_variant(case, m, h) for m in ("pbd", "warm pbd"))
    sunk = [np.abs(run.x[-1] - case.x0).max() / h for run in (cold, warm)]
    assert sunk[0] == pytest.approx(10.0, abs=0.1)  # n (n - 1) / 2
    assert sunk[1] < 1e-3
    loads = np.diff(warm.impulse, axis=0)[-1] / h
    assert loads == pytest.approx([5.0, 4.0, 3.0, 2.0, 1.0], rel=1e-4)


def test_kept_impulses_are_scaled_with_the_step():
    case = nsbench.get_case("stack", n=4)
    h = 1e-3
    # two steps of h / 2 between samples first, then single ones of 0.7 h
    t = h * np.concatenate((np.arange(300), 299 + 0.7 * np.arange(1, 21)))
    warm = run_variant(case.replace(t=t), "warm pbd", 0.7 * h)
    loads = np.diff(warm.impulse, axis=0) / np.diff(t)[:, None]
    assert np.abs(loads[250:] - [4.0, 3.0, 2.0, 1.0]).max() < 1e-6


def test_a_contact_that_opens_is_let_go():
    case = nsbench.get_case("tide")
    h = 0.005
    freed = accumulate(case, "pbd", h)
    stuck = accumulate(case, "pbd", h, is_taken_back=False)
    exact = case.exact(case.t)
    assert np.abs(freed.x - exact).max() < 2 * h < np.abs(stuck.x - exact).max()
    assert np.diff(freed.impulse, axis=0).min() >= 0.0


def test_load_reaches_the_floor_as_a_wave_and_swings():
    found = [[follow_column(n, m) for n in (6, 12)] for m in ("pbd", "warm pbd")]
    for n, cold, warm in zip((6, 12), *found, strict=True):
        assert warm["arrived"] == n - 1 < cold["arrived"]
        assert warm["peak"] > 1.5 > 1.01 > cold["peak"]
        # kept multipliers halve the damping
        assert warm["steps"][-1] / cold["steps"][-1] == pytest.approx(2.0, abs=0.15)


def test_arrival_is_the_first_step_with_the_load():
    assert arrives_at(np.array([0.0, 0.5, 0.995, 0.2]), 1.0) == 2
    assert arrives_at(np.array([0.0, 0.5]), 1.0) is None


def test_reactions_of_a_pile_are_right_row_by_row():
    small, large = (follow_pile(rows, "pbd") for rows in (3, 6))
    assert small["discs"] == 11 and len(small["steps"]) == 3
    assert 2.5 < max(large["steps"]) / max(small["steps"]) < 5.0  # four times for twice the rows
    assert large["steps"][0] > large["steps"][-1]
    warm = follow_pile(6, "warm pbd")
    assert warm["arrived"] <= 6 < large["arrived"]
    assert max(warm["steps"]) > max(large["steps"])
    late = large | {"steps": [3, None, 4]}
    assert len(fit_growth([small, large, follow_pile(4, "pbd"), late])["over_square"]) == 3


def test_smooth_constraints_are_refused():
    tide = nsbench.get_case("tide")
    floor = nsbench.Smooth(lambda xp: lambda t, x: x)
    case = tide.replace(problem=nsbench.Complementarity(tide.problem.drift, (floor,)))
    with pytest.raises(ValueError, match="Smooth"):
        accumulate(case, "pbd", 0.01)


def test_the_guide_of_the_figure_is_the_measured_growth():
    column = {"n": 5, "method": "pbd", "steps": [60, 55]}
    rows = [
        {"case": "c", "order": "sorted", "start": start, "sweeps": s, "state": 0.1 * s}
        for start in (ZERO, KEPT)
        for s in (1, 3)
    ]
    columns = [column, column | {"n": 10, "steps": [240, 220]}]
    svg = settling_figure(columns, [], {"pbd": {"over_square": [2.2, 2.34]}}, [rows]).svg
    assert "2.34 n^2" in svg and "sorted, warm" in svg
