"""The action gates a repository that holds a case, nsbench.toml and a baseline, and nothing else."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
ACTION = yaml.safe_load((ROOT / "action.yml").read_text(encoding="utf-8"))
SCRIPT = ROOT / ".github" / "gate" / "run.sh"
CASE = '''"""Falls: a point that falls onto a floor."""
from pathlib import Path
import numpy as np
from nsbench import Affine, Case, Complementarity

GROWTH = float(Path(__file__).with_name("growth.txt").read_text())    # of the force


def drift(xp):
    return lambda t, y: -xp.ones_like(y) - GROWTH * t


def exact(t):
    return np.maximum(0.5 - t - 0.5 * GROWTH * t**2, 0.0)[:, None]


problem = Complementarity(drift, (Affine(np.eye(1), np.zeros(1)),))
CASE = Case(name="falls", problem=problem, x0=[0.5], t=np.linspace(0.0, 1.0, 11), exact=exact)
'''
PROJECT = """
cases = ["falls.py"]
methods = ["pbd"]
baseline = "baseline.csv"

[ladders]
h = [0.05, 0.04, 0.03, 0.02, 0.01]
"""


@pytest.fixture(scope="module")
def reviewed(tmp_path_factory):
    """A folder with a reviewed baseline, and nothing that was made on the way to it."""
    if shutil.which("bash") is None:
        pytest.skip("the action is a script for bash")
    folder = tmp_path_factory.mktemp("reviewed")
    (folder / "falls.py").write_text(CASE)
    (folder / "growth.txt").write_text("1.0\n")
    (folder / "nsbench.toml").write_text(PROJECT)
    nsbench(folder, "run", "-j", "1")
    nsbench(folder, "calibrate", "-j", "1")
    nsbench(folder, "gate", "--update", "--reason", "The first numbers.")
    shutil.rmtree(folder / "results")
    return folder


@pytest.fixture
def repository(reviewed, tmp_path):
    """A copy of it."""
    return Path(shutil.copytree(reviewed, tmp_path / "repository"))


def nsbench(folder, *words):
    command = [sys.executable, "-m", "nsbench", *words]
    subprocess.run(command, cwd=folder, check=True, capture_output=True)


def act(folder, **inputs):
    """The step of action.yml that gates, with these inputs; returns exit code and summary."""
    bin_folder = folder.parent / f"{folder.name}_bin"
    bin_folder.mkdir(exist_ok=True)
    command = bin_folder / "nsbench"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m nsbench "$@"\n')
    command.chmod(0o755)
    summary = bin_folder / "summary.md"
    summary.unlink(missing_ok=True)
    step = ACTION["runs"]["steps"][-1]
    filled = {k: v["default"] for k, v in ACTION["inputs"].items()} | inputs
    for name, value in step["env"].items():
        os.environ[name] = filled[value.strip("${} ").removeprefix("inputs.")]
    os.environ |= {
        "PATH": f"{bin_folder}{os.pathsep}{os.environ['PATH']}",
        "GITHUB_ACTION_PATH": str(ROOT),
        "GITHUB_STEP_SUMMARY": str(summary),
    }
    done = subprocess.run(["bash", "-c", step["run"]], cwd=folder, capture_output=True, text=True)
    return done.returncode, summary.read_text() if summary.exists() else done.stderr


@pytest.fixture(autouse=True)
def own_environment():
    before = dict(os.environ)
    yield
    os.environ.clear()
    os.environ.update(before)


@pytest.mark.long
def test_green_then_red_with_a_fault(repository):
    """The fault is in a file that the case reads: the case is the same file, its numbers are not."""
    assert act(repository)[0] == 0
    (repository / "growth.txt").write_text("1.001\n")
    code, summary = act(repository)
    assert code == 1 and "regressed" in summary


@pytest.mark.long
def test_inputs_come_before_the_project_file(repository):
    shutil.copy(repository / "baseline.csv", repository / "other.csv")
    (repository / "baseline.csv").unlink()
    assert act(repository, baseline="other.csv", cases="falls.py\n", methods="pbd\n")[0] == 0
    code, why = act(repository, cases="no_such_case")
    assert code == 2 and "no_such_case" in why


def test_the_script_is_there_and_is_what_the_action_calls():
    assert SCRIPT.is_file() and SCRIPT.name in ACTION["runs"]["steps"][-1]["run"]
    assert set(ACTION["inputs"]) == {"cases", "methods", "baseline"}
