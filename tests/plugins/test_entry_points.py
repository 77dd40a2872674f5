"""Cases and methods of installed packages run by name; what is broken is listed and costs nothing."""

import csv
import sys

import pytest
from still_solver import solver

import nsbench
from nsbench import solvers
from nsbench.case import registry
from nsbench.cli import main
from nsbench.source_files import plugins

CASE = '''"""Tissue: a point that falls onto a floor."""
import numpy as np
from nsbench import Affine, Case, Complementarity


def make(speed: float = 1.0):
    def drift(xp):
        return lambda t, y: -speed * xp.ones_like(y) - t

    problem = Complementarity(drift, (Affine(np.eye(1), np.zeros(1)),))
    return Case(name="my_tissue", problem=problem, x0=[0.5], t=np.linspace(0.0, 1.0, 11))
'''
ENTRY_POINTS = """
[nsbench.cases]
my_tissue = my_package.my_tissue
missing = my_package.missing
other_name = my_package.my_tissue
raises = my_package.raises
tide = my_package.tide
elsewhere = no_such_package.elsewhere

[nsbench.solvers]
my_method = my_package.my_method
no_method = my_package.no_method
pbd = my_package.pbd
"""


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """A package with plugins, as pip leaves it: its folder and its metadata."""
    package = tmp_path / "site" / "my_package"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "my_tissue.py").write_text(CASE)
    (package / "tide.py").write_text(CASE)
    (package / "raises.py").write_text("raise RuntimeError('on purpose')")
    solver(package, "my_method")
    solver(package, "pbd")
    (package / "no_method.py").write_text("x = 1")
    notes = package.parent / "my_package-1.0.dist-info"
    notes.mkdir()
    (notes / "METADATA").write_text("Metadata-Version: 2.1\nName: my-package\nVersion: 1.0\n")
    (notes / "entry_points.txt").write_text(ENTRY_POINTS)
    monkeypatch.syspath_prepend(package.parent)
    forget()
    yield package
    monkeypatch.undo()
    for name in [n for n in sys.modules if n.partition(".")[0] == "my_package"]:
        del sys.modules[name]
    forget()


def forget():
    plugins.forget()
    registry._plugin_module.cache_clear()


@pytest.mark.long
def test_a_case_and_a_method_of_a_package_run_by_name(installed, tmp_path, monkeypatch):
    """By workers, which find them too."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(installed.parent))
    command = ["run", "my_tissue[speed=2]", "tide", "-s", "my_method", "--h", "0.1,0.05"]
    assert main([*command, "-j", "1"]) == 0
    with open("results/runs.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {(r["case"], r["solver"], r["status"]) for r in rows} == {
        ("my_tissue[speed=2]", "my_method", "ok"),
        ("tide", "my_method", "ok"),
    }
    assert main(["calibrate", "-j", "1"]) == 0


def test_python_finds_them_by_name(installed):
    case = nsbench.get_case("my_tissue", speed=2.0)
    assert case.source == str(installed / "my_tissue.py")
    assert nsbench.solve(case, "my_method", h=0.1).status.ok
    assert len(nsbench.run("my_tissue", "my_method", h=0.1).rows) == 1


def test_what_is_broken_is_listed_with_the_reason_and_the_rest_goes_on(installed, capsys):
    assert main(["list"]) == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines() if line.split()}
    for name, why in {
        "missing": "no such Python file",
        "other_name": "other_name.py is needed",
        "raises": "on purpose",
        "elsewhere": "no_such_package",
        "no_method": "does not define SOLVER",
    }.items():
        assert "FAILED TO LOAD" in lines[name] and why in lines[name]
    assert "a point that falls" in lines["my_tissue"] and "Stays where it is" in lines["my_method"]
    with pytest.raises(ValueError, match=r"case 'raises' failed to load.*on purpose"):
        nsbench.get_case("raises")


def test_names_of_nsbench_stay_its_own(installed, capsys):
    assert nsbench.get_case("tide").source != str(installed / "tide.py")
    assert type(solvers.get("pbd")).__module__.startswith("nsbench.")
    main(["list"])
    told = capsys.readouterr().out
    assert "a case of nsbench bears this name" in told
    assert "a method of nsbench bears this name" in told


def test_nothing_of_a_package_is_imported_before_it_is_asked_for(installed):
    nsbench.get_case("tide")
    nsbench.solve("tide", "pbd", h=0.1)
    with pytest.raises(LookupError, match="did you mean 'my_tissue'"):
        nsbench.get_case("my_tisue")
    assert "my_package" not in sys.modules


def test_the_standard_suite_is_the_same_whatever_is_installed(installed):
    solvers.get("my_method")
    assert "my_method" not in solvers.standard() and "my_tissue" not in registry.case_names()
