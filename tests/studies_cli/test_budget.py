"""Budgets: seconds at equal error, error against spread, what a reference of one's own hides."""

from dataclasses import replace

import numpy as np
import pytest

from nsbench.studies.budget import costs, model_error, self_reference, study
from nsbench.studies.finding import Effort
from nsbench.studies.part_journal import PartJournal


def rows(method, constant, seconds, steps=(1, 2, 4, 8)):
    """Runs of a method of order 1 whose seconds grow with the number of steps."""
    return [
        {"method": method, "h": 1.0 / n, "error": constant / n, "seconds": seconds * n}
        for n in steps
    ]


def test_seconds_at_an_error_are_interpolated_and_marked_where_extrapolated():
    own = rows("pbd", 1.0, 0.1)
    assert costs.cost_at(own, "pbd", 0.3) == costs.Cost(pytest.approx(0.1 / 0.3), False)
    assert costs.cost_at(own, "pbd", 0.01) == costs.Cost(pytest.approx(10.0), True)
    assert costs.cost_at(own, "pbd", 2.0) == costs.Cost(pytest.approx(0.1), False)


def test_nothing_is_said_below_the_bound_of_the_truth_or_before_convergence():
    own = rows("pbd", 1.0, 0.1)
    assert np.isnan(costs.cost_at(own, "pbd", 0.01, floor=0.02).seconds)
    level = [{**r, "error": 1.0} for r in own]
    assert np.isnan(costs.cost_at(level, "pbd", 0.5).seconds)
    # steps that still become cheaper: the curve bends, and is not continued
    cheap = [{**r, "seconds": 0.1 * 1.3**k} for k, r in enumerate(own)]
    assert np.isnan(costs.cost_at(cheap, "pbd", 0.01).seconds)
    # an error of rounding counts as the bound of the truth: it has reached the target at once
    exact = [{**r, "error": 0.0} for r in own]
    assert costs.cost_at(exact, "pbd", 0.5, floor=1e-9).seconds == pytest.approx(0.1)


def test_errors_that_grow_again_are_no_progress():
    own = rows("pbd", 1.0, 0.1)
    own[1]["error"] = 1e-3  # by luck: the next step is worse
    assert costs.cost_at(own, "pbd", 0.2).seconds > own[2]["seconds"]


def test_ratios_and_profiles_follow_from_the_curves():
    """Ten times the cost per step and a fortieth of the error: a quarter of the seconds."""
    scene = {
        "rows": rows("pbd", 1.0, 0.1) + rows("catching_up", 1.0 / 40.0, 1.0),
        "truth_error": 0.0,
    }
    other = {
        "rows": rows("pbd", 1.0, 0.1) + rows("catching_up", 1.0, 0.3),
        "truth_error": 0.0,
    }
    ratio, extrapolated = costs.ratio_at(scene, 1e-2)
    assert ratio == pytest.approx(0.25) and extrapolated
    assert costs.error_ratio(scene) == pytest.approx(40.0)
    shares = costs.profile([scene, other], 1e-2, (1.0, 3.5, 10.0))
    assert shares == {"pbd": [0.5, 0.5, 1.0], "catching_up": [0.5, 1.0, 1.0]}


def test_both_methods_are_measured_on_a_scene():
    found = costs.measure_scene("corner[psi=60.0]", 0.01)
    assert {r["method"] for r in found["rows"]} == set(costs.METHODS)
    assert found["step_ratio"]["low"] <= found["step_ratio"]["median"]
    for method in costs.METHODS:
        errors = [r["error"] for r in found["rows"] if r["method"] == method]
        assert len(errors) >= costs.MIN_RUNS and errors[-1] < errors[0]


def test_a_truth_is_confirmed_by_one_of_another_kind():
    case = costs.find_discs(3)
    truth = costs.find_truth(case)
    found = costs._confirm(case, truth)
    assert 0.0 < found["distance"] < found["bound"] < 1e-2
    wrong = replace(truth, x=truth.x + 2.0 * found["bound"])
    with pytest.raises(ArithmeticError, match="differ by"):
        costs._confirm(case, wrong)


def made_seed(seed, true, off, unknown=1e-6):
    runs = [{"method": "pbd", "h": 0.1, "status": "ok", "values": {"height": true + off}}]
    return {"seed": seed, "truth": {"height": true}, "truth_error": unknown, "runs": runs}


def test_numerical_errors_are_compared_with_the_spread_over_seeds():
    values = np.random.default_rng(1).normal(5.0, 2.0, 40)
    (row,) = model_error.compare([made_seed(k, v, 0.2) for k, v in enumerate(values)])
    assert row["rms"] == pytest.approx(0.2) and row["spread"] == values.std(ddof=1)
    assert row["ratio"] == pytest.approx(0.2 / row["spread"])
    assert row["low"] < 0.1 < row["high"]  # of the drawn distribution
    (row,) = model_error.compare([made_seed(k, 5.0 + 1e-9 * k, 0.2) for k in range(4)])
    assert row["ratio"] is None  # the truth is not known well enough to tell a spread


def test_a_seed_whose_truth_is_not_known_widens_the_interval():
    values = np.random.default_rng(1).normal(5.0, 2.0, 40)
    unknown = np.where(np.arange(40) == 7, 1.0, 0.0)
    seeds = [made_seed(k, v, 0.2, unknown[k]) for k, v in enumerate(values)]
    assert model_error.truth_error(seeds) == pytest.approx(40**-0.5)
    (plain,) = model_error.compare([made_seed(k, v, 0.2, 0.0) for k, v in enumerate(values)])
    (row,) = model_error.compare(seeds)
    assert row["ratio"] == plain["ratio"]
    assert row["low"] == pytest.approx(plain["low"] * (1.0 - 40**-0.5 / 0.2))
    assert row["high"] == pytest.approx(plain["high"] * (1.0 + 40**-0.5 / 0.2))


def test_a_reference_of_the_same_method_hides_its_own_error(monkeypatch):
    monkeypatch.setattr(self_reference, "STEPS", (0.1, 0.002))
    monkeypatch.setattr(self_reference, "METHODS", ("pbd", "catching_up"))
    found = self_reference.compare_references()
    pbd, qp = (
        [r for r in found["rows"] if r["method"] == m and r["h"] == 0.002][0]
        for m in ("pbd", "catching_up")
    )
    assert found["own_error"] > 100.0 * found["truth_error"]
    assert pbd["self"] < 0.6 * pbd["true"] and qp["self"] > 5.0 * qp["true"]
    assert pbd["true"] <= pbd["self"] + found["own_error"]


@pytest.mark.long
def test_the_study_in_a_tiny_form(monkeypatch):
    monkeypatch.setattr(study, "DISCS", (("3",), ()))
    monkeypatch.setattr(study, "OTHERS", ((), ()))
    monkeypatch.setattr(study, "SECONDS", (0.01, 0.01))
    monkeypatch.setattr(study, "SEEDS", (2, 2))
    monkeypatch.setattr(study, "END", (0.05, 0.05))
    monkeypatch.setattr(study, "TRUTH_SUBSTEPS", (10, 10))
    monkeypatch.setattr(self_reference, "STEPS", (0.1,))
    finding = study.conduct(Effort(False, PartJournal(None), lambda line: None))
    assert finding.answer.startswith("On 3 to 3 free discs a step of catching-up takes")
    assert {t.key for t in finding.tables} >= {"steps", "seconds", "profiles", "references"}
