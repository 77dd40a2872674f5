"""The registry of checks: names, statuses, precedence, and the page that is generated from it."""

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import nsbench
from nsbench import Affine, Case, Complementarity, solvers
from nsbench.diagnostics import CHECKS, Check, Finding, RunView, diagnose
from nsbench.solvers.event_driven.method import EventDriven
from nsbench.solvers.nosnoc.method import Nosnoc
from nsbench.study import status_page
from nsbench.trajectory import STATUSES, Resolution, Status, Trajectory

ALL = (*CHECKS, *EventDriven().checks, *Nosnoc().checks)
PAGE = Path(__file__).parents[2] / "docs" / "statuses.md"


def drift(xp):
    return lambda t, x: 0.0 * x


CASE = Case(
    "rest",
    Complementarity(drift, (Affine(np.eye(1), np.ones(1)),)),
    np.zeros(1),
    np.array([0.0, 1.0]),
)


def run_of(status=Status()):
    none = np.empty((2, 0))
    return Trajectory(CASE.t, np.zeros((2, 1)), (), none, np.zeros((2, 1)), status)


def test_names_are_unique_and_statuses_are_of_the_closed_list():
    names = [c.name for c in ALL]
    assert len(set(names)) == len(names)
    assert all(c.gives and set(c.gives) < set(STATUSES) - {"ok"} for c in ALL)


def test_the_committed_page_is_current():
    assert PAGE.read_text(encoding="utf-8") == status_page.generate_status_page()


@pytest.mark.parametrize("check", ALL, ids=lambda c: c.name)
def test_a_check_tells_its_criterion_and_its_file(check):
    source = (PAGE.parents[1] / check.source).read_text(encoding="utf-8")
    find = getattr(check.find, "func", check.find)
    assert check.criterion and f"def {find.__name__}(" in source


@pytest.mark.parametrize("entry", status_page.WITHOUT_CHECK, ids=lambda e: e.sentence[:40])
def test_statuses_without_a_check_stand_in_the_file_that_is_named(entry):
    """As string constants next to each other, which the parser joins."""
    tree = ast.parse((PAGE.parents[1] / entry.source).read_text(encoding="utf-8"))
    words = (n.value for n in ast.walk(tree) if isinstance(n, ast.Constant))
    assert entry.status in STATUSES
    assert any(entry.sentence in w for w in words if isinstance(w, str))


def test_a_finding_names_its_check_and_those_of_the_method_come_first():
    checks = (
        Check("nothing", Complementarity, lambda run: None, ("diverged",)),
        Check("other problem", nsbench.Filippov, lambda run: 1 / 0, ("diverged",)),
        Check("first", Complementarity, lambda run: Finding("nan", "One."), ("nan",)),
        Check("second", Complementarity, lambda run: Finding("diverged", "Two."), ("diverged",)),
    )
    status = diagnose(CASE, run_of(), checks).status
    assert (status.code, str(status), status.check) == ("nan", "One.", "first")
    assert diagnose(CASE, run_of(), checks[:2]).status == Status()


def test_a_run_that_is_not_ok_is_not_checked():
    never = Check("never", Complementarity, lambda run: 1 / 0, ("diverged",))
    bad = Status("maxiter", "Too many steps.")
    assert diagnose(CASE, run_of(bad), (never,)).status is bad


def test_a_case_with_a_closed_form_is_checked_where_that_is_stated():
    found = lambda run: Finding("unverified", "It is.")
    exact = replace(CASE, exact=lambda t: np.zeros((len(t), 1)))
    for always in (True, False):
        check = Check("either", Complementarity, found, ("unverified",), even_if_exact=always)
        assert diagnose(exact, run_of(), (check,)).status.ok is not always


@pytest.mark.parametrize("label, rule", [("start", "explicit"), ("end", "implicit"), ("mean", "")])
def test_a_run_without_a_resolution_is_judged_by_its_labels(label, rule):
    run = replace(run_of(), stats={"h": 0.5}, lam_time=label)
    assert RunView(CASE, run).resolution == Resolution(step=0.5, rule=rule)
    stated = replace(run, resolution=Resolution())
    assert RunView(CASE, stated).resolution == Resolution()


def test_every_method_states_its_resolution():
    """Of those that can run a small case of each problem class."""
    known = {}
    for case in map(nsbench.get_case, ("tide", "sliding", "rlc_diode")):
        for name in solvers.all_names():
            method = solvers.get(name)
            if name in ("pbd_jax", "nosnoc") or method.refuses(case):
                continue
            accuracy = {"h": 0.05, "tol": 1e-6, "k": 50.0}[method.accuracy]
            run = method.prepare(case, accuracy)()
            assert run.resolution is not None and run.status.check == "", name
            known[name, type(case.problem).__name__] = run.resolution
    assert known["euler", "Filippov"].rule == "explicit"
    assert known["penalty", "Filippov"].layer == 1.0 / 50.0
    assert known["penalty", "Complementarity"].layer == 0.0
    assert known["event_driven", "LCS"] == Resolution()


def test_a_timed_run_holds_no_check(monkeypatch):
    """The zero-argument run of a method, which the clock times, evaluates no check."""
    import nsbench.diagnostics as diagnostics

    def raises(*args):
        raise AssertionError("a check within a timed run")

    case = nsbench.get_case("sliding")
    runs = [
        solvers.get("penalty").prepare(case, 50.0),
        solvers.get("euler").prepare(case, 0.05),
        solvers.get("euler[implicit=true]").prepare(case, 0.05),
    ]
    monkeypatch.setattr(diagnostics.RunView, "__init__", raises)
    assert all(run().status.ok for run in runs)


def test_the_column_check_names_the_check_that_gave_the_status():
    """Of a row with a finding; it is empty where there is none, and where the method refuses."""
    from nsbench.study import Spec
    from nsbench.study.attempt import attempt

    file = str(Path(__file__).parents[1] / "regressions" / "pole_between_samples.py")
    key = nsbench.load_case(file).key
    row, _ = attempt(Spec(key, "kdtree", "h", 0.01, file=file))
    assert (row["status"], row["check"]) == ("diverged", "drift_pole"), row["why"]
    assert attempt(Spec("sliding", "euler", "h", 0.05))[0]["check"] == ""
    assert attempt(Spec("sliding", "pbd", "h", float("nan")))[0]["check"] == ""
