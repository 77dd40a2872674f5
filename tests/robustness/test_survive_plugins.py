"""A plugin that is broken, named like another, or strange takes nothing with it: the message names
it."""

import re
import sys

import nsbench.cases
import numpy as np
import pytest
from still_solver import solver
from survive_files import HEAD, case_file

import nsbench
from nsbench import solvers
from nsbench.case import registry as cases
from nsbench.cli import main
from nsbench.solvers import registry


@pytest.fixture
def plugins(tmp_path, monkeypatch):
    """Two more folders of plugins; the scans are made anew, here and after the test."""
    folders = {}
    for package, module in (("cases", cases), ("solvers", registry)):
        folders[package] = tmp_path / package
        folders[package].mkdir()
        home = nsbench.cases if package == "cases" else solvers
        monkeypatch.setattr(home, "__path__", [*home.__path__, str(folders[package])])
        module._scan.cache_clear()
    before = set(sys.modules)
    yield folders
    for name in set(sys.modules) - before:
        if name.startswith(("nsbench.cases.", "nsbench.solvers.")):
            del sys.modules[name]
    monkeypatch.undo()
    cases._scan.cache_clear()
    registry._scan.cache_clear()


BROKEN = {
    "missing": "import no_such_library",
    "raises": "raise RuntimeError('on purpose')",
    "half": "def (",
    "exits": "import sys; sys.exit(3)",
    "leaves": "import os; os._exit(0)",
    "nothing": "x = 1",
}


MAKES = """
def make():
    {}


SUITES = {{"smoke": [{{}}]}}
"""


@pytest.mark.long
@pytest.mark.survives("broken plugin")
def test_plugins_that_do_not_load_are_listed_with_the_reason_and_the_others_work(
    plugins, tmp_path, capsys
):
    for name, text in BROKEN.items():
        for package in plugins.values():
            (package / f"zz_{name}_{package.name}.py").write_text(text)
    bare = solver(plugins["solvers"], "zz_bare")
    bare.write_text(
        bare.read_text().replace("    accuracy, default", "    speed: float\n    accuracy, default")
    )
    (plugins["solvers"] / "zz_five.py").write_text("SOLVER = 5")
    (plugins["solvers"] / "zz_class.py").write_text("class SOLVER: pass")
    solver(plugins["solvers"], "zz_silent", doc="")
    plain = case_file(plugins["cases"], name="zz_plain")
    plain.write_text(plain.read_text().split("\n", 1)[1])
    assert main(["list"]) == 0
    told = capsys.readouterr().out
    for name, said in (
        ("missing", "no_such_library"),
        ("raises", "on purpose"),
        ("half", "SyntaxError"),
        ("exits", "SystemExit"),
        ("leaves", "os._exit(0)"),
        ("nothing", "neither CASE nor make"),
        ("nothing", "does not define SOLVER"),
    ):
        assert any(
            f"zz_{name}" in line and "FAILED TO LOAD" in line and said in line
            for line in told.splitlines()
        ), name
    assert re.search(r"zz_five .*FAILED TO LOAD.*SOLVER.*is 5", told) and re.search(
        r"zz_class .*FAILED TO LOAD.*dataclass", told
    )
    assert re.search(r"zz_bare .*FAILED TO LOAD.*no default of speed", told)
    assert re.search(r"zz_silent +Still", told) and re.search(r"zz_plain +\(says nothing", told)
    for args, said in (
        (["run", "zz_raises_cases"], "on purpose"),
        (["run", "tide", "-s", "zz_raises_solvers"], "on purpose"),
    ):
        assert main(args) == 2
        assert said in capsys.readouterr().err
    assert (
        main(["run", "tide", "-s", "pbd", "--h", "0.1", "-o", str(tmp_path / "r"), "--plan"]) == 0
    )
    assert nsbench.solve("tide", "pbd", h=0.1).status.ok


@pytest.mark.survives("broken plugin")
def test_a_registered_case_that_cannot_be_made_is_left_out_and_told(plugins, tmp_path, capsys):
    makes = {
        "raises": ("raise NameError('nowhere')", "NameError: nowhere"),
        "gone": ("exit(0)", "SystemExit"),
        "leaves": ("import os; os._exit(0)", "os._exit(0)"),
    }
    for name, text in {"broken": "1/0"}.items() | {
        n: MAKES.format(does) for n, (does, _) in makes.items()
    }.items():
        (plugins["cases"] / f"zz_{name}.py").write_text(text)
    for name, (_, said) in makes.items():
        assert main(["show", f"zz_{name}"]) == 2
        assert said in capsys.readouterr().err, name
    assert (
        main(
            [
                "run",
                "--suite",
                "smoke",
                "-s",
                "pbd",
                "--h",
                "0.1",
                "--plan",
                "--probe",
                "0",
                "-o",
                str(tmp_path / "r"),
            ]
        )
        == 3
    )
    told = capsys.readouterr().out
    assert all(f"left out: zz_{name}" in told for name in (*makes, "broken"))
    assert int(re.search(r"(\d+) to run", told)[1]) >= 8, told


@pytest.mark.survives("same name")
def test_registered_names_that_are_equal_but_for_case_name_both_files(plugins, capsys):
    one = case_file(plugins["cases"], name="zz_twin")
    other = case_file(plugins["cases"], name="ZZ_twin")
    for name in ("zz_twin", "ZZ_twin"):
        assert main(["run", name, "--plan"]) == 2
        said = capsys.readouterr().err
        assert str(one) in said and str(other) in said


@pytest.mark.survives("same name")
def test_a_registered_case_is_named_like_its_file(plugins, capsys):
    path = case_file(plugins["cases"], name="tide")
    path.rename(path.with_name("zz_other.py"))
    assert main(["run", "zz_other", "--plan"]) == 2
    said = capsys.readouterr().err
    assert "'tide'" in said and "zz_other.py" in said


@pytest.mark.long
@pytest.mark.survives("not picklable")
def test_what_cannot_be_pickled_runs_because_it_travels_by_name(tmp_path):
    """A lock and closures in a case and in a solver; two workers, spawned."""
    text = (
        f"{HEAD}import threading\nLOCK = threading.Lock()\n\n\ndef drift(xp):\n    if xp is np:\n"
        "        with LOCK:\n            pass\n    return lambda t, x: -1.0 + 0 * x\n\n\n"
        "CASE = Case(name='{}', problem=Complementarity(drift, (Affine(np.eye(1), "
        "np.zeros(1)),)), x0=[1.0],\n"
        "            t=[0.0, 1, 2], params={{'lock': LOCK}})\n"
    )
    for name in ("one", "two"):
        (tmp_path / f"{name}.py").write_text(
            text.replace("{}", name).replace("{{", "{").replace("}}", "}")
        )
    method = solver(tmp_path, "locked", prepare="import threading; self_lock = threading.Lock()")
    args = [
        "run",
        "--cases",
        str(tmp_path / "one.py"),
        "--cases",
        str(tmp_path / "two.py"),
        "--solvers",
        str(method),
        "-j",
        "2",
        "-s",
        "pbd",
        "-s",
        "locked",
        "--h",
        "0.1",
        "-o",
        str(tmp_path / "r"),
    ]
    assert main(args) == 0
    rows = (tmp_path / "r" / "runs.csv").read_text()
    # both cases get a reference, which one of the methods is nearer to than it can tell
    assert rows.count(",ok,") + rows.count(",below_reference,") == 4


@pytest.mark.survives("not picklable")
def test_an_object_that_is_handed_over_is_what_runs():
    """Not the registered case of the same name."""
    tide = nsbench.get_case("tide")
    moved = tide.replace(x0=np.array([3.0]), exact=None, exact_impulse=None)
    row = nsbench.run([moved.replace(name="moved")], "pbd", h=0.1).rows[0]
    assert row["status"] == "ok" and np.isnan(row["state_sup"]) and row["reference"] == "none"
    row = nsbench.run([moved], "pbd", h=0.1).rows[0]
    assert row["status"] == "error" and "another version of tide" in row["why"]
    assert np.isfinite(nsbench.run([tide], "pbd", h=0.1).rows[0]["state_sup"])
