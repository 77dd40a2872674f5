"""Maps of status and error: every cell a number or a named failure; what held stacks do."""

import numpy as np
import pytest

from nsbench.studies.finding import Effort
from nsbench.studies.part_journal import PartJournal
from nsbench.studies.stability import study
from nsbench.studies.stability.held_stack import JITTER_STEPS, STEP, hold
from nsbench.studies.stability.maps import DIVISORS, OWN, Map, fill_row, methods_of
from nsbench.studies.plateau.scenes import find_scene


@pytest.mark.long
def test_a_stiff_drift_gives_named_failures_and_implicit_steps_give_numbers():
    cells = fill_row("stiff_contact[K=1000]", ["pbd", "theta", "event_driven"])
    by_method = {m: [c for c in cells if c["method"] == m] for m in ("pbd", "theta")}
    assert all(c["status"] != "ok" and c["sentence"] for c in by_method["pbd"])
    assert all(c["status"] == "ok" and c["error"] < 0.1 for c in by_method["theta"])
    own = [c for c in cells if c["column"] == OWN]
    assert [c["method"] for c in own] == ["event_driven"] and own[0]["error"] < 1e-9
    assert len(by_method["pbd"]) == len(DIVISORS)


def test_the_methods_of_a_map_are_those_that_take_the_case():
    corner = methods_of(find_scene("corner[psi=60]"))
    assert {"pbd", "catching_up", "event_driven", "theta", "penalty"} <= set(corner)
    assert not {m for m in corner if m.startswith(("euler", "kdtree", "solve_ivp"))}
    assert "theta" not in methods_of(find_scene("discs[n=3,seed=0]"))


def test_a_low_stack_sinks_by_what_the_loads_above_leave_and_then_rests():
    """At rest each contact is left with h times the load that is processed after it."""
    n = 4
    row = hold(n, 400, "pbd")
    h = STEP / n
    loads = n - np.arange(1.0, n)  # contact k is violated by h times the load above it
    assert row["sunk"] == pytest.approx(h * loads.sum(), rel=0.3)
    assert row["jitter"] < 1e-12 and abs(row["drift"]) < 1e-9 and row["sideways"] == 0.0
    assert row["energy"] < 0.0 and row["rise"] < 1e-12
    assert hold(n, 400, "catching_up")["sunk"] < 1e-12


@pytest.mark.long
def test_jitter_is_taken_from_single_steps():
    """A tall stack is still sinking: single steps move by less than all of them together."""
    row = hold(30, 200, "pbd")
    assert 0.0 < row["jitter"] < row["h"]
    assert row["jitter"] * JITTER_STEPS < row["sunk"]


@pytest.mark.long
def test_the_study_in_a_tiny_form(monkeypatch):
    tiny = Map("stiffness", "stiffness K", "stiff_contact[K={:g}]", (10, 1e4), (10,))
    monkeypatch.setattr(study, "MAPS", (tiny,))
    monkeypatch.setattr(study, "HOLDS", (((4, 200),), ()))
    monkeypatch.setattr(study, "fill_row", lambda key: fill_row(key, ["pbd", "theta"]))
    finding = study.conduct(Effort(False, PartJournal(None), lambda line: None))
    assert "12 of 16 cells end well" in finding.answer
    failures = next(t for t in finding.tables if t.key == "failures")
    assert len(failures.rows) == 4 and all(r[-1] for r in failures.rows)
    assert "of 1 stacks held by PBD 1 have come to rest" in finding.answer


def test_a_cell_without_error_and_reason_is_a_contradiction(monkeypatch):
    tiny = Map("stiffness", "stiffness K", "stiff_contact[K={:g}]", (10,), (10,))
    monkeypatch.setattr(study, "MAPS", (tiny,))
    cell = {"method": "pbd", "column": "/1", "h": 0.1, "status": "ok", "sentence": ""}
    monkeypatch.setattr(study, "fill_row", lambda key: [{**cell, "error": None, "share": None}])
    with pytest.raises(ArithmeticError, match="no error and no reason"):
        study.conduct(Effort(False, PartJournal(None), lambda line: None))
