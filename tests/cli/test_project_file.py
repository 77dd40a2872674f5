"""`nsbench.toml` names what a folder runs and is compared with; names of cases follow one rule."""

import csv
import subprocess
import sys

import pytest

import nsbench
from nsbench.case.selection import cases_of
from nsbench.cli import main
from nsbench.cli.arguments import build_parser
from nsbench.cli.project_file import apply_project_file
from nsbench.solvers import registry

FALLS = '''"""A point that falls onto a floor: y' = -speed + lam, 0 <= y _|_ lam >= 0."""
import numpy as np
from nsbench import Affine, Case, Complementarity

SUITES = {"standard": [{}], "full": [{"speed": 2.0}]}


def make(speed: float = 1.0):
    def drift(xp):
        return lambda t, y: -speed * xp.ones_like(y) - t

    problem = Complementarity(drift, (Affine(np.eye(1), np.zeros(1)),))
    return Case(name="falls", problem=problem, x0=[0.5], t=np.linspace(0.0, 1.0, 11))
'''
PROJECT = '''
cases = ["falls.py[speed=1.5]"]
methods = ["clip"]
method_files = ["clip.py"]
baseline = "baseline.csv"

[ladders]
h = [0.05, 0.04, 0.03, 0.02, 0.01]
'''


@pytest.fixture
def folder(tmp_path, monkeypatch, runs_here):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "method", "clip"]) == 0
    (tmp_path / "falls.py").write_text(FALLS)
    (tmp_path / "nsbench.toml").write_text(PROJECT)
    return tmp_path


def rows():
    with open("results/runs.csv", newline="") as file:
        return list(csv.DictReader(file))


def test_a_run_says_what_it_takes_from_the_file(folder, capsys):
    assert main(["run", "tide", "-s", "pbd", "--plan", "--probe", "0"]) == 0
    assert "from nsbench.toml: method_files, h\n" in capsys.readouterr().out
    assert main(["run", "falls.py", "--plan", "--probe", "0"]) == 0
    assert "from nsbench.toml: methods, method_files, h\n" in capsys.readouterr().out


def test_methods_of_the_file_are_shown_and_listed(folder, capsys):
    """Those of --solvers too; without either, the message says how a method of one's own is
    named."""
    for options in ([], ["--solvers", "clip.py"]):
        assert main(["show", "falls.py", "-s", "clip", "--h", "0.05", *options]) == 0
        assert capsys.readouterr().out.count("clip: ok.") == 1
        assert main(["list", *options]) == 0
        assert "\n  clip  " in capsys.readouterr().out
        (folder / "nsbench.toml").unlink(missing_ok=True)
        registry._loaded.clear()
    assert main(["show", "falls.py", "-s", "clip", "--h", "0.05"]) == 2
    assert "--solvers FILE, in Python nsbench.solvers.load(FILE)" in capsys.readouterr().err
    with pytest.raises(LookupError, match=r"of a file: nsbench\.load_case\('falls\.py'\)"):
        nsbench.solve("falls.py", "pbd")


def test_the_command_that_is_stored_holds_the_options_of_the_file(folder):
    """Where there is no such file it does the same."""
    args = build_parser().parse_args(["run", "--timeout", "9"])
    args.argv = ["run", "--timeout", "9"]
    apply_project_file(args)
    again = build_parser().parse_args(args.argv)
    (folder / "nsbench.toml").unlink()
    apply_project_file(again)
    for name in ("cases", "solver", "solver_files", "h", "timeout", "out", "suite"):
        assert getattr(again, name) == getattr(args, name), name
    assert again.cases == ["falls.py[speed=1.5]"] and again.solver == ["clip"]


@pytest.mark.long
def test_plain_run_and_gate_do_what_the_file_says(folder, capsys):
    """Green, and red after a fault in the method."""
    assert main(["run", "-j", "1"]) == 0
    assert {(r["case"], r["solver"]) for r in rows()} == {("falls[speed=1.5]", "clip")}
    assert len(rows()) == 5
    assert main(["calibrate", "-j", "1"]) == 0
    assert main(["gate", "--update", "--reason", "The first numbers of this folder."]) == 0
    assert main(["gate"]) == 0
    method = folder / "clip.py"
    method.write_text(method.read_text().replace("x = x + step * f", "x = x + 1.01 * step * f"))
    capsys.readouterr()
    assert main(["gate"]) == 4  # before the runs are made anew
    assert "clip: the file of the method has changed" in capsys.readouterr().out
    again = [sys.executable, "-m", "nsbench", "run", "-j", "1"]  # this process knows the old file
    subprocess.run(again, check=True, capture_output=True)
    assert main(["gate"]) == 1, capsys.readouterr().out


def test_rows_of_an_older_case_file_are_not_compared(folder, capsys):
    assert main(["run", "-s", "pbd", "-j", "1"]) == 0
    assert main(["calibrate", "-j", "1"]) == 0
    update = ["gate", "--update", "--reason", "The first numbers of this folder."]
    assert main(update) == 0
    before = main(["gate"])
    # the case of the rows is no longer one that the project names
    changed = FALLS.replace("- t", "- 2.0 * t").replace("speed: float = 1.0", "speed: float = 1.5")
    (folder / "falls.py").write_text(changed)
    for words in (["gate", "--summary", "summary.md"], ["gate", "results"], update):
        assert main(words) == 4
        assert "falls[speed=1.5]: the case file has changed" in capsys.readouterr().out
    assert "Not compared" in (folder / "summary.md").read_text()
    (folder / "falls.py").unlink()  # the gate needs no case
    assert main(["gate"]) == main(["gate", "--cases", "references"]) == before
    assert "has changed" not in capsys.readouterr().out


def test_rows_of_another_folder_are_not_held_against_the_files_of_the_project(folder, capsys):
    assert main(["run", "-s", "pbd", "-j", "1", "-o", "before"]) == 0
    (folder / "falls.py").write_text(FALLS.replace("- t", "- 2.0 * t"))
    (folder / "baseline.csv").write_text("")
    main(["gate", "before"])
    assert "has changed" not in capsys.readouterr().out
    assert main(["gate", "before", "--cases", "falls.py"]) == 4


def test_options_come_first(folder):
    assert main(["run", "tide", "-s", "pbd", "--h", "0.1", "-j", "1"]) == 0
    assert [(r["case"], r["solver"], float(r["asked"])) for r in rows()] == [("tide", "pbd", 0.1)]


@pytest.mark.parametrize(
    "text, sentence",
    [
        ("case = []", "entry 'case'; did you mean 'cases'?"),
        ("cases = 3", "a list of texts is needed"),
        ("[ladders]\nhh = 1", "[ladders] of nsbench.toml has the entry 'hh'"),
        ("cases = [", "nsbench.toml cannot be read"),
        ("baseline = 1.5", "a text is needed"),
    ],
)
def test_a_wrong_entry_is_named(folder, text, sentence, capsys):
    (folder / "nsbench.toml").write_text(text)
    assert main(["run"]) == 2
    assert sentence in capsys.readouterr().err


def test_gate_without_a_baseline_says_where_one_is_named(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["gate"]) == 2
    assert "nsbench.toml" in capsys.readouterr().err


@pytest.mark.parametrize(
    "name, suite, keys",
    [
        ("falls.py", "standard", ["falls"]),
        ("falls.py", "full", ["falls", "falls[speed=2]"]),
        ("falls.py[speed=0.123456789]", "standard", ["falls[speed=0.123456789]"]),
        (".", "standard", ["falls"]),
        ("discs[n=3]", "standard", ["discs[n=3,seed=0]"]),
    ],
)
def test_a_name_is_a_case_a_file_or_a_folder(folder, name, suite, keys):
    assert [case.key for case, _ in cases_of(name, suite)] == keys


@pytest.mark.parametrize(
    "args, sentence",
    [
        (["run", "tide", "-s", "pbd", "--tol", "1e-3"], "pbd takes 'h', not 'tol'"),
        (["run", "gone.py[a=1]"], "no file gone.py"),
        (["show", "falls.py[sped=1]"], "did you mean 'speed'?"),
        (["reference", "list", "falls.py[speed=x]"], "parameter speed of falls is 'x'"),
        (["run", "suites.py"], "SUITES of"),
    ],
)
def test_what_a_name_cannot_be_is_refused(folder, args, sentence, capsys):
    (folder / "nsbench.toml").unlink()
    (folder / "suites.py").write_text(FALLS.replace('{"standard": [{}]', '{"standart": [{}]'))
    assert main(args) == 2
    assert sentence in capsys.readouterr().err


def test_show_takes_a_path_with_parameters(folder, capsys):
    assert main(["show", "falls.py[speed=2]", "-s", "pbd", "--h", "0.01"]) == 0
    assert "falls[speed=2]: Complementarity" in capsys.readouterr().out
