"""What `nsbench run` prints at its end, for people and for programs, and how it exits."""

import json

import pytest

import nsbench
from nsbench.cli import main

PBD = ["tide", "-s", "pbd", "--h", "5e-2..5e-4", "-j", "1"]


@pytest.fixture
def here(tmp_path, monkeypatch, runs_here):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_run_ends_with_a_table_before_the_path(here, capsys):
    assert main(["run", *PBD]) == 0
    lines = capsys.readouterr().out.splitlines()
    head, row, path = lines[-3:]
    assert head.split()[:2] == ["case", "best"] and path == "report: results/report.html"
    assert row.startswith("tide") and "pbd (h = " in row and " 1.0" in row


def test_a_run_in_which_everything_is_refused_does_not_exit_0(here, capsys):
    assert main(["run", "tide", "-s", "euler", "-j", "1"]) == 4
    assert "nothing ran: every method refuses" in capsys.readouterr().out


def test_json_is_all_that_is_printed(here, capsys):
    assert main(["run", *PBD, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["cases"][0]["best"] == "pbd" and told["statuses"]["ok"] > 18
    assert main(["run", *PBD, "-q"]) == 0
    assert capsys.readouterr().out == "report: results/report.html\n"


def test_show_prints_no_number_that_is_none(capsys):
    assert main(["show", "slide_exit", "-s", "euler", "--h", "0.01"]) == 0
    text = capsys.readouterr().out
    assert "nan" not in text and "state_sup" in text


def test_version(capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["--version"])
    assert stopped.value.code == 0 and nsbench.__version__ in capsys.readouterr().out


def test_an_order_is_printed_with_the_digits_of_its_interval():
    from nsbench.report.summary import Order
    from nsbench.report.tables.order_table import order_cell

    cell = order_cell(Order("state_sup", "fit", "", "", 1.0021, (1.0016, 1.0024), verdict="order"))
    low, high = cell.small.split(" … ")
    assert float(low) <= float(cell.text) <= float(high)


def test_reprs_are_short_and_rooms_are_reached_lazily():
    traj = nsbench.solve("tide", "pbd", h=0.01)
    case = nsbench.get_case("discs", n=30)
    study = nsbench.run("tide", "pbd", h=0.1)
    for made in (traj, case, case.problem, study, nsbench.reference.reference(case)):
        assert len(repr(made)) < 250, repr(made)
    assert isinstance(traj, nsbench.Trajectory) and isinstance(study, nsbench.Study)
    assert "pbd" in nsbench.solvers.all_names()
    with pytest.raises(AttributeError):
        nsbench.nowhere  # noqa: B018
