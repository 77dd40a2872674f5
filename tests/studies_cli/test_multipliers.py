"""Multipliers: steps until they are right, sweeps against steps at equal cost, error bars."""

import numpy as np
import pytest

import nsbench
from nsbench.studies.finding import Effort
from nsbench.studies.multipliers import study
from nsbench.studies.multipliers.effectivity import measure_bars
from nsbench.studies.multipliers.equal_cost import (
    KEPT,
    ORDERS,
    SWEEPS,
    WARM_SWEEPS,
    best_division,
    spend,
)
from nsbench.studies.multipliers.settling import (
    fit_growth,
    follow_column,
    follow_events,
    settled_from,
    step_multipliers,
)
from nsbench.studies.part_journal import PartJournal


def test_a_contact_has_settled_when_it_is_right_for_good():
    true = np.ones((6, 3))
    found = true.copy()
    found[0, 1] = 0.0  # wrong once, at the beginning
    found[[1, 3], 2] = 2.0  # right in between
    assert settled_from(found, true).tolist() == [0, 1, 4]
    found[5, 0] = 2.0
    assert settled_from(found, true)[0] == 6


def test_multipliers_of_single_steps_are_increments_of_the_impulse():
    found, true = step_multipliers(nsbench.get_case("tide"), "pbd", 0.01, 100)
    assert found.shape == true.shape == (100, 1)
    assert np.abs(found[60:] - true[60:]).max() < 0.01 and true[0] == 0.0


def test_a_column_needs_a_number_of_steps_that_grows_with_the_square_of_its_height():
    columns = [follow_column(n, "pbd") for n in (4, 8, 12)]
    growth = fit_growth(columns)
    assert growth["power"] == pytest.approx(2.0, abs=0.1)
    assert growth["over_square"][-1] == pytest.approx(1.78, abs=0.1)
    quick = follow_column(8, "pbd[sweeps=4]")["steps"][-1]
    assert quick == pytest.approx(columns[1]["steps"][-1] / 4, abs=2)
    assert follow_column(4, "catching_up")["steps"] == [0, 0, 0, 0]


def test_steps_after_an_event_do_not_depend_on_the_step():
    counts = [
        [e["steps"] for e in follow_events("rods_wall[n=3]", "pbd", divisor)]
        for divisor in (128, 512)
    ]
    assert len(counts[0]) == 3 and counts[0][0] == 0 < counts[0][1] < counts[0][2]
    assert np.abs(np.subtract(*counts)).max() <= 2
    qp = follow_events("rods_wall[n=3]", "catching_up", 128)
    assert max(e["steps"] for e in qp) <= 1


def test_the_cost_is_kept_when_sweeps_take_the_place_of_steps():
    rows = spend("rods_wall[n=3]", 32)
    assert len(rows) == len(ORDERS) * (len(SWEEPS) + len(WARM_SWEEPS))
    spacing = 0.1
    for r in rows:
        cost = r["sweeps"] + (r["start"] == KEPT)
        assert r["h"] == pytest.approx(cost * spacing / 32)
    for start in ("zero", "kept"):
        best = best_division(rows, "state", start)
        assert best["state"] == min(r["state"] for r in rows if r["start"] == start)
        assert best["end"] <= best["state"]


def test_error_bars_are_compared_with_errors_that_are_known():
    (row,) = measure_bars("tide", "pbd", (4,))
    assert row["kind"] == "bound" and 1.0 <= row["least"] and row["state"] < 1.5
    for key in ("wedge", "apple"):  # exact to rounding: no error to compare with
        assert measure_bars(key, "catching_up", (4,)) == []


def test_a_bound_below_an_error_is_a_contradiction(monkeypatch):
    monkeypatch.setattr(study, "_settle", lambda *args: [])
    monkeypatch.setattr(study, "_settle_events", lambda effort: [])
    monkeypatch.setattr(study, "_divide_costs", lambda effort: [])
    bars = [{"kind": "bound", "least": 0.99, "case": "tide"}]
    monkeypatch.setattr(study, "_measure_bars", lambda effort: bars)
    with pytest.raises(ArithmeticError, match="a bound below an error"):
        study.conduct(Effort(False, PartJournal(None), lambda line: None))


@pytest.mark.long
def test_the_study_in_a_tiny_form(monkeypatch):
    monkeypatch.setattr(study, "COLUMNS", ((3, 5, 7), ()))
    monkeypatch.setattr(study, "PILES", ((2, 3, 4), ()))
    monkeypatch.setattr(study, "EVENT_CASES", ("rods_wall[n=3]",))
    monkeypatch.setattr(study, "DIVISORS", (64,))
    monkeypatch.setattr(study, "COST_CASES", (("rods_wall[n=3]",), ()))
    monkeypatch.setattr(study, "SWEEPS_PER_SAMPLE", (16, 16))
    monkeypatch.setattr(study, "BAR_CASES", (("tide",), ()))
    finding = study.conduct(Effort(False, PartJournal(None), lambda line: None))
    assert "n^2 steps (power 2.0" in finding.answer or "n^2 steps (power 1.9" in finding.answer
    keys = {"columns", "piles", "events", "equal-cost", "effectivity"}
    assert {t.key for t in finding.tables} == keys
    assert any("warm pbd" in e for e in finding.evidence)
