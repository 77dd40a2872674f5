"""A tolerance of the gate comes from what a method leaves open, never from a tolerance read as a
step, and none lets ten times the claim of a method pass."""

import argparse
from dataclasses import replace

import numpy as np
import pytest
from report_rows import STEPS, row

import nsbench
from nsbench import study
from nsbench.cli import main
from nsbench.gate import baseline, calibrate, spreads
from nsbench.gate.comparison import compare
from nsbench.gate.facts import Fact, facts
from nsbench.gate.update import updated
from nsbench.measure.orders.window import rounding
from nsbench.report.data import build, columns_of, read
from nsbench.report.summary import summarise
from nsbench.results import tables
from nsbench.study.attempt import attempt
from nsbench.study.describe import describe_case, describe_solver

TOL = 1e-12
BOUND = 1e-10  # what event_driven claims
SPEC = "event_driven"


def data_of(rows, solvers=None):
    """Rows as the report reads them, with the descriptions of their cases and solvers."""
    solvers = solvers or {s: describe_solver(s) for s in {r["solver"] for r in rows}}
    cases = {c: describe_case(nsbench.get_case(c)) for c in {r["case"] for r in rows}}
    return build(columns_of(rows), cases=cases, solvers=solvers)


def lines_of(rows, spread=0.0, solvers=None):
    found = facts(data_of(rows, solvers))
    return found, {key: baseline.line(fact, spread, "first") for key, fact in found.items()}


def outcomes(found, lines):
    return {f.key[3]: f.outcome for f in compare(found, lines)}


@pytest.mark.parametrize("case", ["tide", "two_discs"])
@pytest.mark.parametrize("fault, seen", [("events", "event_time"), ("impulses", "impulse")])
def test_moved_events_and_scaled_impulses_of_contacts_are_seen(case, fault, seen):
    check_fault(case, fault, seen)


@pytest.mark.parametrize("case", ["slide_exit", "stick_slip"])
@pytest.mark.parametrize("fault, seen", [("events", "event_time"), ("impulses", "impulse")])
def test_moved_events_and_scaled_impulses_of_filippov_systems_are_seen(case, fault, seen):
    check_fault(case, fault, seen)


def check_fault(case, fault, seen):
    """Hold a run of event_driven against itself with its events 1e-4 later, or its impulses
    multiplied by 1.0001."""
    spec = study.Spec(case, SPEC, "tol", TOL)
    plain = attempt(spec)[0]
    problem = nsbench.get_case(case)
    traj = nsbench.solve(problem, SPEC, tol=TOL)
    wrong = replace(traj, impulse=1.0001 * traj.impulse)
    if fault == "events":
        wrong = replace(traj, events=tuple(replace(e, t=e.t + 1e-4) for e in traj.events))
    _, lines = lines_of([plain])
    assert set(outcomes(facts(data_of([plain])), lines).values()) == {"pass"}
    found = facts(data_of([plain | nsbench.errors(problem, wrong)]))
    assert outcomes(found, lines)[seen] == "regressed"


@pytest.mark.parametrize("solver", ["event_driven", "solve_ivp", "solve_ivp[method=lsoda]"])
@pytest.mark.parametrize("size", [1.0, 40.0])
def test_no_error_of_ten_times_the_claim_passes(solver, size):
    rows = [
        row("tide", solver, TOL, "tol", state_sup=1e-15, event_time=0.0, state_scale=size)
        | {"impulse": 2e-15, "impulse_scale": size}
    ]
    found, lines = lines_of(rows)
    claim = describe_solver(solver)["claims"]["exact"]
    for key, fact in found.items():
        if fact.metric in ("state_sup", "event_time", "impulse"):
            line = lines[key]
            assert line.held and fact.floor == pytest.approx(2e-12 * size)
            times = 1.0 if fact.metric == "state_sup" else size
            worse = {key: replace(fact, value=10.0 * claim * times)}
            assert compare(worse, {key: line})[0].outcome == "regressed", fact.metric


def test_a_reference_that_tells_less_than_the_claim_widens_no_tolerance():
    rows = [row("tide", SPEC, TOL, "tol", state_sup=3e-12, state_floor=5e-9)]
    found, lines = lines_of(rows)
    (key,) = [k for k in found if k[3] == "state_sup"]
    assert found[key].kind == "max" and lines[key].atol <= BOUND


def test_at_a_looser_tolerance_the_claim_is_as_many_times_larger():
    rows = [
        row("tide", "solve_ivp", tol, "tol", state_sup=tol) | {"asked": tol}
        for tol in (1e-5, 1e-7, 1e-9, 1e-12)
    ]
    found, _ = lines_of(rows)
    fact = found["tide", "solve_ivp", "tol=1e-07", "state_sup"]
    assert fact.claim == pytest.approx(1e-5) and fact.kind == "max"
    assert fact.floor == pytest.approx(1e-7, rel=1e-3)


@pytest.mark.parametrize("accuracy", ["tol", "k"])
def test_only_steps_add_roundings(accuracy):
    h = np.array([1e-3, 1e-12])
    assert np.all(rounding(h, 2.0, 20.0, accuracy) == 2e-12)
    assert rounding(h, 2.0, 20.0)[1] > 1e-3


def test_an_order_in_a_tolerance_is_fitted_to_its_finest_runs():
    tols = np.geomspace(1e-5, 1e-10, 25)
    rows = [row("tide", "own", float(t), "tol", state_sup=float(3 * t)) for t in tols]
    known = {"own": {"accuracy": "tol", "claims": {"state": 1.0, "impulse": 1.0}}}
    order = summarise(data_of(rows, known))["tide", "own"].state
    assert order.kind == "fit" and order.order == pytest.approx(1.0, abs=1e-3)
    assert min(order.window) == pytest.approx(1e-10)


def test_an_order_claims_the_size_of_the_solution_times_its_power():
    rows = [
        row("tide", "richardson", float(h), state_sup=1e-14, state_scale=3.0)
        for h in 0.03 / np.arange(1, 4)
    ]
    found, lines = lines_of(rows)
    (fact,) = [f for f in found.values() if f.metric == "state_sup"]
    h = rows[1]["h"]
    assert fact.claim == pytest.approx(3.0 * (h / 3.0) ** 2)
    assert lines[fact.key].held
    assert not baseline.line(fact, 1.1 * fact.claim, "").held


def claimed_fact(kind="max", value=1e-13):
    return Fact("stack", SPEC, "tol=1e-12", "l1", kind, value, "", "case=aa", 1e-11, claim=4e-9)


@pytest.mark.parametrize("spread, held", [(0.0, True), (3.9e-9, True), (4.1e-9, False)])
def test_a_spread_beyond_the_claim_gives_no_tolerance(spread, held):
    fact = claimed_fact()
    line = baseline.line(fact, spread, "")
    assert line.held == held and (held or line.atol == 0.0)
    expected = "regressed" if held else "not held"
    worse = replace(fact, value=4.1e-8)
    assert compare({fact.key: worse}, {fact.key: line})[0].outcome == expected


def test_a_value_that_breaks_its_claim_is_held_near_itself():
    fact = claimed_fact("near", 0.46)
    line = baseline.line(fact, 0.0, "")
    assert line.held and not baseline.is_blind(line, fact)


@pytest.mark.parametrize("kind", ["near", "max"])
@pytest.mark.parametrize("times, blind", [(10.0, False), (10.05, True)])
def test_a_line_is_blind_from_ten_times_the_claim_on(kind, times, blind):
    fact = claimed_fact(kind)
    room = times * fact.claim - abs(fact.value) * (kind == "max")
    line = replace(baseline.line(fact, 0.0, ""), atol=room, rtol=0.0)
    assert baseline.is_blind(line, fact) == blind


def study_in(folder, value=1e-15):
    """Results on disk: one run of event_driven on tide."""
    folder.mkdir()
    tables.write_tables(folder, [row("tide", SPEC, TOL, "tol", state_sup=value, impulse=2e-15)])
    (folder / "solvers.json").write_text(
        '{"event_driven": {"accuracy": "tol", "claims": {"exact": 1e-10}}}'
    )
    return folder


def test_calibration_names_each_line_that_it_refuses(tmp_path, monkeypatch):
    folder = study_in(tmp_path / "r")
    moved = read(study_in(tmp_path / "moved", 1e-6))
    monkeypatch.setattr(calibrate, "_again", lambda *args: moved)
    said = []
    args = argparse.Namespace(jobs=1, timeout=10.0)
    assert calibrate.calibrate(folder, args, said.append) == 0
    name = "not to be held: tide event_driven tol=1.01e-12 state_sup"
    (refused,) = [s for s in said if s.startswith(name)]
    assert "ten times" in refused and "1e-10" in refused
    assert any(s.startswith("event_driven: of 1 number the widest lets") for s in said)


def test_the_gate_tells_a_blind_line_and_an_update_mends_it(tmp_path, capsys):
    folder = study_in(tmp_path / "r")
    base = tmp_path / "base.csv"
    gate = ["gate", str(folder), "--baseline", str(base)]
    found = facts(read(folder))
    none = dict.fromkeys(found, 0.0)
    (folder / "calibration.csv").write_text(spreads.text(none, found))
    lines = {k: baseline.line(f, 0.0, "first") for k, f in found.items()}
    (key,) = [k for k in lines if k[3] == "state_sup"]
    good = dict(lines)
    lines[key] = replace(lines[key], atol=4.4e-4)
    base.write_text(baseline.text(lines.values()))
    assert main(gate) == 0
    said = capsys.readouterr().out
    assert "event_driven: of 2 numbers the widest lets 4.4e+06 times the claim pass" in said
    assert " ".join(key) in said and "1 let more than 10 times pass" in said
    assert main([*gate, "--update", "--reason", "claims"]) == 0
    assert "state_sup: 1e-15 -> 1e-15, within 0.00044 -> within 1.9e-12" in capsys.readouterr().out
    mended = baseline.read(base)
    assert mended[key] == replace(good[key], why="claims")
    assert all(mended[k] == line for k, line in good.items() if k != key)
    assert main(gate) == 0 and "let more than" not in capsys.readouterr().out


def test_the_facts_of_a_ladder_are_its_statuses_verdicts_orders_and_half_widths():
    """Of errors that are not known there are none, of a method that refuses its statuses alone."""
    h = 0.1 / np.unique(np.round(4 * 2 ** np.arange(0, 6.4, 0.35)))
    errors = h * np.exp(0.01 * np.cos(np.arange(len(h))))
    pairs = zip(h, errors, strict=True)
    rows = [row("tide", "pbd", float(v), state_sup=float(e)) for v, e in pairs]
    rows = [r | {"impulse": float("nan"), "reaction": float("nan")} for r in rows]
    rows.append(row("sliding", "pbd", float("nan"), status="refused", why="It has no constraints."))
    found = {(k[0], k[3]): f.value for k, f in facts(data_of(rows)).items() if k[2] == "ladder"}
    names = ("statuses", "state verdict", "state order", "state constant", "state half-width")
    assert {name for case, name in found if case == "tide"} == {*names}
    assert {name for case, name in found if case == "sliding"} == {"statuses"}
    assert found["tide", "statuses"] == f"{len(h)} ok"
    assert found["sliding", "statuses"] == "1 refused"
    low, high = nsbench.fit_order(h, errors, span=2 * np.pi).interval
    assert found["tide", "state half-width"] == pytest.approx((high - low) / 2, rel=0.002)


@pytest.mark.parametrize("kind, value", [("class", "order"), ("count", 7.0), ("near", 2.0)])
def test_a_line_that_holds_no_number_near_itself_lets_nothing_pass(kind, value):
    fact = replace(claimed_fact(), kind=kind, value=value)
    line = replace(baseline.line(fact, 0.0, ""), rtol=0.0 if kind != "near" else np.inf)
    assert baseline.times_claim(line, fact) == 0.0


def test_residuals_are_claimed_to_be_rounding_whatever_the_order():
    rows = [row("tide", "pbd", h) | {"feasibility": 1e-15} for h in STEPS]
    claims = {f.claim for k, f in facts(data_of(rows)).items() if k[3].startswith("feasibility")}
    assert claims == {1e-9}


def test_a_method_without_claims_claims_no_more_than_rounding():
    rows = [row("tide", "pbd", h, state_sup=h) for h in STEPS]
    solvers = {"pbd": describe_solver("pbd") | {"claims": {}}}
    found = facts(data_of(rows, solvers))
    claims = {f.claim for k, f in found.items() if k[2] != "ladder" and "state_sup" in k[3]}
    assert len(claims) == 1 and max(claims) < 1e-11


def test_the_status_of_a_run_that_ended_badly_is_its_own():
    endings = ("ok", "timeout", "diverged")
    steps = zip((0.1, 0.05, 0.02), endings, strict=True)
    found = facts(data_of([row("tide", "pbd", h, status=s) for h, s in steps]))
    assert [f.value for k, f in found.items() if k[3] == "status"] == ["timeout"]


def test_a_number_that_is_new_in_the_baseline_is_named_with_its_value():
    found = {f.key: f for f in (claimed_fact(), replace(claimed_fact(), metric="sup"))}
    old = {key: baseline.line(f, 0.0, "") for key, f in [*found.items()][:1]}
    _, changes = updated(found, old, dict.fromkeys(found, 0.0), "first")
    assert changes == ["stack event_driven tol=1e-12 sup: new, 1e-13"]


def test_a_bound_claimed_by_a_method_with_steps_is_the_claim_at_every_step():
    rows = [row("tide", "pbd", h, state_sup=0.5 * h) for h in (0.4, 0.2, 0.1)]
    solvers = {"pbd": {"accuracy": "h", "claims": {"exact": 1e-3}}}
    claims = [f.claim for k, f in facts(data_of(rows, solvers)).items() if k[3] == "state_sup"]
    assert claims == [1e-3]
