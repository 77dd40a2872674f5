"""Inputs that no import statement names, and rows that are not of the run they are stored for."""

import contextlib
import csv
import os
import py_compile

import pytest
from command_server import Commands
from solver_file import solver

from nsbench import get_case
from nsbench.results.journal import Journal
from nsbench.results.row_reuse import RowRecorder, reusable_rows, row_mismatch
from nsbench.results.run_key import parts_of
from nsbench.study import Spec

HEADER = """import os, sys
sys.path.insert(0, os.path.join(os.path.dirname(__file__), "li" + "b"))
helper = __import__("hel" + "per")
"""
VARIABLES = "NSTEST_FACTOR", "NSTEST_TERM"
FORKS = """
    import time
    here = os.path.dirname(__file__)
    forked = [name for name in os.listdir(here) if name.startswith("forked-")]
    if forked and forked != ["forked-" + case.name]:
        open(here + "/go", "w").close()
        time.sleep(1.5)
    elif not forked:                                          # not where it is repeated
        open(here + "/forked-" + case.name, "w").close()
        if os.fork() == 0:
            until = time.monotonic() + 30.0
            while not os.path.exists(here + "/go") and time.monotonic() < until:
                time.sleep(0.01)
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """What `nsbench run` prints, in a process of its own: byte code is cached, modules are not."""
    env = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    with Commands(tmp_path_factory.mktemp("commands"), env) as command:

        def run(folder, *more, cases=("tide",), **variables):
            args = ["run", *cases, "--solvers", "mine.py", "-s", "mine", "--h", "0.1", "-j", "1"]
            done = command(*args, "-o", "out", *more, cwd=folder, **variables)
            assert done.returncode in (0, 3), done.stderr
            return done.stdout

        yield run


def rows(folder):
    with open(folder / "out" / "runs.csv", newline="") as file:
        return list(csv.DictReader(file))


def test_files_of_a_solver_are_known_by_their_place_beside_it(tmp_path):
    """The key of a run is the same in two checkouts, and another one for another text."""
    digests = []
    for place, text in (("a", "ONE = 1"), ("b", "ONE = 1"), ("c", "ONE = 2")):
        (tmp_path / place / "lib").mkdir(parents=True)
        (tmp_path / place / "mine.py").write_text(solver("", before="import lib.one"))
        (tmp_path / place / "lib" / "one.py").write_text(text)
        files = (str(tmp_path / place / "mine.py"),)
        spec = Spec("tide", "mine", "h", 0.1, solver_files=files)
        digests.append(parts_of(spec, get_case("tide"))[1].digest)
    assert digests[0] == digests[1] != digests[2]


def test_a_library_counts_with_those_that_it_needs(tmp_path):
    (tmp_path / "mine.py").write_text(solver("", before="import pandas"))
    spec = Spec("tide", "mine", "h", 0.1, solver_files=(str(tmp_path / "mine.py"),))
    held = dict(parts_of(spec, get_case("tide"))[1].items)
    assert {"pandas", "python-dateutil"} <= held.keys()


@pytest.mark.long
@pytest.mark.survives("stale")
def test_a_module_at_a_computed_place_counts_though_its_byte_code_is_cached(tmp_path, run):
    helper = tmp_path / "lib" / "helper.py"
    helper.parent.mkdir()
    helper.write_text("value = 1.0\n")
    py_compile.compile(str(helper))
    (tmp_path / "mine.py").write_text(HEADER + solver("pass", stats='{"mark": helper.value}'))
    run(tmp_path)
    assert rows(tmp_path)[0]["mark"] == "1.0"
    assert "0 to run, 1 known" in run(tmp_path, "--plan")
    helper.write_text("value = 22.0\n")
    for _ in range(2):  # the first plan compiles the module again
        said = run(tmp_path, "--plan", "--probe", "0")
        assert "1 to run, 0 known" in said and "helper.py" in said


@pytest.mark.long
@pytest.mark.survives("stale")
@pytest.mark.parametrize("when", ["load", "run"])
def test_a_variable_that_a_file_looks_up_is_an_input(tmp_path, when, run):
    """Whichever way."""
    text = f"c = float(os.environ['{VARIABLES[0]}']) + float(os.getenv('{VARIABLES[1]}'))"
    header = f"import os\n{text}\n" if when == "load" else ""
    body = solver("pass" if when == "load" else text, stats='{"mark": c}')
    (tmp_path / "mine.py").write_text(header + body)
    values = dict.fromkeys(VARIABLES, "1.0")
    run(tmp_path, **values)
    assert rows(tmp_path)[0]["mark"] == "2.0"
    assert "0 to run, 1 known" in run(tmp_path, "--plan", **values, OTHER="3")
    for name in VARIABLES:
        said = run(tmp_path, "--plan", "--probe", "0", **(values | {name: "2.0"}))
        assert "1 to run, 0 known" in said and f"environment variable {name} changed" in said


@pytest.mark.survives("stale")
def test_a_row_of_another_run_is_neither_reused_nor_recorded(tmp_path):
    """Whatever brings it: a journal, or a worker."""
    specs = [Spec(case, "pbd", "h", 0.1) for case in ("tide", "apple")]
    keys = {s: f"{i:064}" for i, s in enumerate(specs)}
    row = {"case": "tide", "solver": "pbd", "accuracy": "h", "asked": 0.1, "status": "ok"}
    with contextlib.closing(Journal(tmp_path)) as journal:
        for key in keys.values():
            journal.append(key, row)
        assert [*reusable_rows(tmp_path, specs, keys, None, [])] == [keys[specs[0]]]
        cases = {(s.case, ""): get_case(s.case) for s in specs}
        recorder = RowRecorder(journal, keys, dict.fromkeys(specs, ()), cases, False)
        assert recorder.row(specs[0], dict(row)) == row
        shown = recorder.row(specs[1], row | {"session": "s"})
    assert shown["status"] == "crashed" and "case is tide, not apple" in shown["why"]
    assert shown["case"] == "apple" and shown["session"] == "s"
    refused = Spec("tide", "pbd", "h", float("nan"))
    assert row_mismatch(refused, row) and not row_mismatch(refused, row | {"asked": float("nan")})
    for name in ("solver", "accuracy", "asked"):
        assert row_mismatch(specs[0], row | {name: None})


@pytest.mark.long
@pytest.mark.survives("stale")
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_row_of_one_case_is_never_stored_for_another(tmp_path, run):
    """A process that a run has forked comes back from it as the worker does, while that is at work
    on the next case."""
    (tmp_path / "mine.py").write_text(solver(FORKS))
    run(tmp_path, cases=("tide", "apple"))
    assert sorted(r["case"] for r in rows(tmp_path)) == ["apple", "tide"]
    assert {r["status"] for r in rows(tmp_path)} <= {"ok", "unverified", "crashed"}
