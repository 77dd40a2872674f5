"""Maps of status and error: every cell a number or a named failure; what held stacks do."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import nnls

from nsbench.solvers import solve
from nsbench.studies.finding import Effort
from nsbench.studies.part_journal import PartJournal
from nsbench.studies.stability import study
from nsbench.studies.stability.held_stack import COLUMN, JITTER_STEPS, PILE, STEP, hold
from nsbench.studies.stability.maps import DIVISORS, MAPS, OWN, Map, fill_row, methods_of
from nsbench.studies.plateau.scenes import find_scene
from nsbench.trajectory import Status


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
    row = hold(COLUMN.format(n), n, 400, "pbd")
    h = STEP / n
    loads = n - np.arange(1.0, n)  # contact k is violated by h times the load above it
    assert row["sunk"] == pytest.approx(h * loads.sum(), rel=0.3)
    assert row["jitter"] < 1e-12 and abs(row["drift"]) < 1e-9 and row["sideways"] == 0.0
    assert row["energy"] < 0.0 and row["rise"] < 1e-12
    assert hold(COLUMN.format(n), n, 400, "catching_up")["sunk"] < 1e-12


@pytest.mark.parametrize("rows", [4, 7])
def test_a_pile_rests_since_forces_of_its_contacts_carry_the_load(rows):
    """-f lies in the cone of the gradients of the contacts that are closed at the start."""
    case = find_scene(PILE.format(rows))
    walls, discs = case.problem.constraints
    x = case.x0.reshape(-1, 2)
    i, j = np.triu_indices(len(x), 1)
    between = x[i] - x[j]
    length = np.linalg.norm(between, axis=1)
    closed = length < discs.d + 1e-12
    assert length.min() > discs.d - 1e-12
    pairs = np.zeros((len(i), len(x), 2))
    pairs[np.arange(len(i)), i] = between / length[:, None]
    pairs[np.arange(len(i)), j] = -between / length[:, None]
    wall = walls.A.toarray()
    gaps = wall @ case.x0 + walls.b
    assert gaps.min() > -1e-12
    gradients = np.vstack((wall[gaps < 1e-12], pairs[closed].reshape(closed.sum(), -1)))
    load = case.problem.drift(np)(0.0, case.x0)
    assert len(gradients) > np.linalg.matrix_rank(gradients)  # the multipliers are not unique
    assert nnls(gradients.T, -load)[1] < 1e-10
    upright = gradients[:, 1::2].sum(axis=1) > 0.5  # the floor: nothing else lifts all discs
    assert upright.sum() == rows and nnls(gradients[~upright].T, -load)[1] > 0.1


def test_a_pile_is_held_in_its_rows_by_short_steps_and_topples_where_they_are_long():
    """What a sweep leaves of a contact is proportional to h: beyond a radius discs lose places."""
    rows = 4
    held = hold(PILE.format(rows), rows, 400, "pbd")
    assert (held["n"], held["rows"], held["toppled"]) == (10, rows, 0)
    assert held["jitter"] < 1e-12 and 0.0 < held["sunk"] < STEP * rows
    assert 0.0 < held["sideways"] < 1.0 and held["energy"] < 0.0
    fallen = hold(PILE.format(13), 13, 1000, "pbd")
    assert fallen["toppled"] > 0 and fallen["sideways"] > 1.0
    finer = hold(PILE.format(13), 13, 4000, "pbd", 4)
    assert finer["h"] == STEP / 52 and finer["toppled"] == 0 and finer["sideways"] < 0.2
    assert hold(PILE.format(rows), rows, 400, "catching_up")["sunk"] < 1e-12


def test_discs_that_move_together_have_not_toppled_and_one_that_passes_another_has():
    from nsbench.studies.stability.held_stack import _count_toppled

    start = np.array([[1.0, 1.0], [3.0, 1.0], [2.0, 1.0 + 3.0**0.5], [9.0, 1.0]])
    together = start - [0.0, 2.5]
    last = start + [[0.0, 0.0], [0.0, 0.0], [0.0, -1.2], [5.0, 0.0]]  # the fourth touched none
    assert _count_toppled(np.stack((start, together))) == 0
    assert _count_toppled(np.stack((start, last))) == 3


def test_the_answer_names_the_piles_and_the_steps_that_topple():
    rest = {"method": "pbd", "sunk": 0.1, "jitter": 0.0}
    piles = [rest | {"n": 10, "toppled": 0}, rest | {"n": 28, "toppled": 3}]
    ladder = [rest | {"n": 91, "h": h, "toppled": int(h > 0.1)} for h in (0.2, 0.1, 0.05)]
    words = study._piles_answer(piles, ladder)
    assert words.startswith("of 2 piles held by PBD 1 have come to rest in their rows")
    assert "in those of 28 discs" in words
    assert "91 discs topples with h = 0.2 and keeps its places with h = 0.1, 0.05" in words
    silent = study._piles_evidence([h | {"status": "ok", "steps": 9} for h in piles])
    assert "pbd 1 of 2" in silent[0] and "in 1 of 2" in silent[0]


def test_a_run_that_stops_early_is_a_named_row_without_numbers(monkeypatch):
    from nsbench.studies.stability import held_stack

    def stop(case, method, **accuracy):
        traj = solve(case, method, **accuracy)
        cut = traj.t[:-1]
        return replace(traj, t=cut, x=traj.x[:-1], status=Status("maxiter", "too many"))

    monkeypatch.setattr(held_stack, "solve", stop)
    row = hold(PILE.format(2), 2, 100, "pbd")
    assert row["status"] == "maxiter" and row["why"] and "sunk" not in row


def test_sweeps_are_a_difficulty_of_the_methods_that_sweep():
    """A load travels by one disc in a sweep, and what is left of its contact falls with them."""
    sweeps = next(m for m in MAPS if m.name == "sweeps")
    assert sweeps.methods(4) == ["pbd[sweeps=4]", "pbd[order=reverse,sweeps=4]"]
    assert MAPS[0].methods(10) is None
    first = {}
    for value, key in sweeps.scenes(False).items():
        cells = fill_row(key, sweeps.methods(value)[:1])
        assert [c["column"] for c in cells] == [f"/{n}" for n in DIVISORS]
        first[value] = cells[0]["error"]
    assert first[1] > first[4] > 2.0 * first[16] > 0.0


def test_piles_are_held_for_fewer_steps_by_methods_whose_steps_are_costly():
    steps = {p.args[:4]: p.key for p in study._piles(True)}
    assert len(set(steps.values())) == len(steps)
    largest = {method: n for key, rows, n, method in steps if rows == 44}
    assert largest["pbd"] == 10**5 > largest["event_driven"] > 0
    assert largest["catching_up"] == study.DISC_STEPS["catching_up"] // 990
    assert 0 in {n for _, _, n, method in steps if method == "pbd[tol=1e-2]"}  # without a run
    assert {n for _, rows, n, _ in steps if rows == 4} == {10**5}
    idle = hold(PILE.format(13), 13, 0, "pbd[tol=1e-2]")
    assert idle["n"] == 91 and idle["status"] == "" and idle["why"] and "sunk" not in idle


@pytest.mark.long
def test_jitter_is_taken_from_single_steps():
    """A tall stack is still sinking: single steps move by less than all of them together."""
    row = hold(COLUMN.format(30), 30, 200, "pbd")
    assert 0.0 < row["jitter"] < row["h"]
    assert row["jitter"] * JITTER_STEPS < row["sunk"]


@pytest.mark.long
def test_the_study_in_a_tiny_form(monkeypatch):
    tiny = Map("stiffness", "stiffness K", "stiff_contact[K={:g}]", (10, 1e4), (10,))
    monkeypatch.setattr(study, "MAPS", (tiny,))
    monkeypatch.setattr(study, "HOLDS", (((4, 200),), ()))
    monkeypatch.setattr(study, "PILES", (((2, 200),), ()))
    monkeypatch.setattr(study, "DIVISORS_OF_PILE", (2, (1, 2)))
    monkeypatch.setattr(study, "fill_row", lambda key: fill_row(key, ["pbd", "theta"]))
    finding = study.conduct(Effort(False, PartJournal(None), lambda line: None))
    assert "12 of 16 cells end well" in finding.answer
    failures = next(t for t in finding.tables if t.key == "failures")
    assert len(failures.rows) == 4 and all(r[-1] for r in failures.rows)
    assert "of 1 stacks held by PBD 1 have come to rest" in finding.answer
    assert f"topples with h = none and keeps its places with h = {STEP / 2:g}" in finding.answer
    assert "of 1 piles held by PBD 1 have come to rest in their rows" in finding.answer
    piles = next(t for t in finding.tables if t.key == "piles")
    assert [r[:2] for r in piles.rows] == [(3, 200)] * len(study.HELD_BY)
    finer = next(t for t in finding.tables if t.key == "pile-steps")
    assert [r[1:3] for r in finer.rows] == [(200, STEP / 2), (400, STEP / 4)] * 2
    assert f"by h: {STEP / 2:g}: 0 topple" in " ".join(finding.evidence)


def test_a_cell_without_error_and_reason_is_a_contradiction(monkeypatch):
    tiny = Map("stiffness", "stiffness K", "stiff_contact[K={:g}]", (10,), (10,))
    monkeypatch.setattr(study, "MAPS", (tiny,))
    monkeypatch.setattr(study, "HOLDS", ((), ()))
    monkeypatch.setattr(study, "PILES", ((), ()))
    monkeypatch.setattr(study, "_finer_piles", list)
    cell = {"method": "pbd", "column": "/1", "h": 0.1, "status": "ok", "sentence": ""}
    monkeypatch.setattr(study, "fill_row", lambda key: [{**cell, "error": None, "share": None}])
    with pytest.raises(ArithmeticError, match="no error and no reason"):
        study.conduct(Effort(False, PartJournal(None), lambda line: None))
