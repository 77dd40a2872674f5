"""No error below ten times the bound of its reference is shown as a number."""

import dataclasses

import numpy as np
import pytest

import nsbench
from nsbench import get_case, reference
from nsbench.study import Spec
from nsbench.study.attempt import attempt


@pytest.fixture
def slack(monkeypatch):
    """slide_exit with a stored reference whose bounds are 1e-6, and the runs measured against
    it."""
    case = get_case("slide_exit")
    ref = dataclasses.replace(
        reference.load(case), state_error=1e-6, impulse_error=1e-6, event_error=1e-6, kind="stored"
    )
    monkeypatch.setattr("nsbench.measure.context.reference", lambda c: ref)
    from nsbench.measure import context

    context._frames.clear()
    yield case, ref
    context._frames.clear()


def test_the_names_of_what_is_below_are_given(slack):
    case, _ = slack
    fine, coarse = (
        nsbench.errors(case, nsbench.solve(case, "event_driven", tol=tol)) for tol in (1e-12, 1e-4)
    )
    assert set(fine["below"].split()) >= {"state_sup", "state_T", "impulse", "event_time", "l1"}
    assert fine["state_floor"] == fine["event_floor"] == 10 * 1e-6
    rough = nsbench.errors(case, nsbench.solve(case, "euler", h=0.05))
    assert rough["below"] == "" and rough["state_sup"] > 1e-3 and coarse["state_sup"] < 1.0


@pytest.mark.survives("coarse reference")
def test_a_row_below_its_reference_has_that_status(slack):
    spec = Spec("slide_exit", "event_driven", "tol", 1e-12)
    row, run = attempt(spec)
    assert (
        row["status"] == "below_reference"
        and "below 1e-05, ten times the bound" in row["why"]
        and run is not None
    )
    row, _ = attempt(Spec("slide_exit", "euler", "h", 0.01))
    assert row["status"] == "ok" and row["below"] == ""


def test_the_state_alone_does_not_make_a_row_below(slack, monkeypatch):
    """A method that is right in the state and wrong in its impulses keeps its number."""
    from nsbench import solvers

    honest = solvers.get("event_driven")

    class Lies:
        accuracy = "tol"
        default = 1e-12

        def refuses(self, case):
            return None

        def prepare(self, case, tol):
            run = honest.prepare(case, tol)
            return lambda: (lambda t: dataclasses.replace(t, impulse=t.impulse * 1.01))(run())

    monkeypatch.setattr("nsbench.study.attempt.solvers.get", lambda s: Lies())
    row, _ = attempt(Spec("slide_exit", "lies", "tol", 1e-12))
    assert (
        row["status"] == "ok"
        and "state_sup" in row["below"]
        and "impulse" not in row["below"].split()
    )


@pytest.mark.survives("coarse reference")
def test_the_report_shows_the_floor_instead():
    from nsbench.report.summary import format_error
    from nsbench.report.tables.reliability_tables import _known

    assert format_error(3e-16, 1e-14) == "< 1e-14" and format_error(3e-13, 1e-14) == "3e-13"
    assert (
        _known({"impulse": 1e-17, "impulse_floor": 1e-15}, "impulse", "impulse_floor") == "< 1e-15"
    )
    assert (
        _known({"impulse": 2e-15, "impulse_floor": np.nan}, "impulse", "impulse_floor") == "2e-15"
    )


def test_show_prints_no_number_below(slack, capsys):
    from nsbench.cli import main

    assert main(["show", "slide_exit", "-s", "event_driven", "--tol", "1e-12"]) == 0
    lines = {s.split()[0]: s for s in capsys.readouterr().out.splitlines() if s.startswith("  ")}
    assert (
        "below ten times the bound" in lines["state_sup"] and "below ten times" in lines["impulse"]
    )
