"""The command line keeps its word: what it prints, where it writes, how it exits."""

import csv
import os
import signal
import subprocess
import sys
import time

import pytest

from nsbench.cli import main
from nsbench.cli.option_values import read_values
from nsbench.results.journal import read_journal


def nsbench(*args, **kw):
    return subprocess.run(
        [sys.executable, "-m", "nsbench", *args], capture_output=True, text=True, **kw
    )


@pytest.mark.long
def test_a_run_ends_with_a_report_and_is_resumed(tmp_path):
    out = str(tmp_path / "r")
    first = nsbench("run", "tide", "-s", "pbd", "--h", "5e-2..1e-3", "-o", out, "-j", "1")
    assert first.returncode == 0, first.stderr
    assert first.stdout.splitlines()[-1] == f"report: {out}/report.html"
    for name in (
        "runs.parquet",
        "runs.csv",
        "journal.jsonl",
        "env.json",
        "report.html",
        "report.md",
        "figures",
    ):
        assert (tmp_path / "r" / name).exists(), name
    before = (tmp_path / "r" / "journal.jsonl").read_bytes()
    again = nsbench("run", "tide", "-s", "pbd", "--h", "5e-2..1e-3", "-o", out, "-j", "1")
    assert again.returncode == 0 and "runs (" not in again.stdout
    assert (tmp_path / "r" / "journal.jsonl").read_bytes() == before
    plan = nsbench("run", "tide", "-s", "pbd", "--h", "5e-2..1e-3,", "-o", out, "--plan")
    assert plan.returncode == 2


@pytest.mark.parametrize(
    "args, text",
    [
        (["run", "tyde"], "did you mean 'tide'?"),
        (["run", "tide", "-s", "pdb"], "did you mean 'pbd'?"),
        (["run", "tide", "-s", "pbd[ordr=reverse]"], "did you mean 'order'?"),
        (["run", "discs[N=3]"], "no parameter 'N'"),
        (["run", "tide", "--h", "-0.1"], "-0.1"),
        (["run", "tide", "--h", "fine"], "fine"),
        (["run", "--tag", "nosuchtag"], "no case matches"),
        (["show", "tide", "-s", "pbd", "--tol", "1e-3"], "takes 'h'"),
        (["report", "nowhere"], "no results in nowhere"),
        (["check", "nowhere.py"], "no file"),
    ],
)
@pytest.mark.survives("nearest name", "nothing matches")
def test_bad_input_exits_2_and_names_the_value(args, text, capsys):
    assert main(args) == 2
    assert text in capsys.readouterr().err


@pytest.mark.survives("output is a file")
def test_output_path_that_is_a_file_is_refused(tmp_path, capsys):
    (tmp_path / "f").write_text("")
    assert main(["run", "tide", "-s", "pbd", "--h", "0.1", "-o", str(tmp_path / "f")]) == 2
    assert "is a file" in capsys.readouterr().err


def test_list_and_show(capsys):
    assert main(["list"]) == 0
    text = capsys.readouterr().out
    assert "tide" in text and "pbd" in text and "state_sup" in text
    assert main(["show", "tide"]) == 0
    assert "y' = -cos t" in capsys.readouterr().out
    assert main(["show", "tide", "-s", "pbd", "--h", "0.01"]) == 0
    assert "state_sup" in capsys.readouterr().out


def test_values_are_read_as_lists_and_ranges():
    assert read_values("1e-2") == [1e-2] and read_values("0.1,0.05") == [0.1, 0.05]
    v = read_values("1e-2..1e-4")
    assert len(v) == 21 and v[0] == pytest.approx(1e-2) and v[-1] == pytest.approx(1e-4)


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_completion_scripts_know_the_verbs_and_their_options(shell, capsys):
    with pytest.raises(SystemExit) as stopped:
        main(["--print-completion", shell])
    script = capsys.readouterr().out
    assert stopped.value.code == 0
    for word in ("calibrate", "--baseline", "--print-completion", "smoke"):
        assert word in script, word
    if shell == "bash":
        checked = subprocess.run(["bash", "-n"], input=script, text=True, capture_output=True)
        assert checked.returncode == 0, checked.stderr


@pytest.mark.long
@pytest.mark.survives("ctrl-c")
def test_interrupted_run_keeps_what_is_finished_and_goes_on(tmp_path):
    out = tmp_path / "r"
    args = [
        sys.executable,
        "-m",
        "nsbench",
        "run",
        "tide",
        "three_discs",
        "-s",
        "pbd",
        "-o",
        str(out),
        "-j",
        "1",
    ]
    p = subprocess.Popen(
        args, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    journal = out / "journal.jsonl"
    for _ in range(3000):  # kernels may have to be compiled first, on a machine with other work
        if journal.exists() and read_journal(out):
            break
        time.sleep(0.1)
    os.killpg(p.pid, signal.SIGINT)
    _, err = p.communicate(timeout=60)
    assert p.returncode == 130, err
    assert read_journal(out)
    reported = nsbench("report", str(out))
    assert reported.returncode == 0 and "planned runs are missing" in reported.stdout
    plan = nsbench(*args[3:], "--plan")
    assert plan.returncode == 0 and "reuse" in plan.stdout


@pytest.mark.long
def test_a_case_and_a_solver_from_files_outside_the_package(tmp_path):
    case = tmp_path / "my_case.py"
    solver = tmp_path / "my_solver.py"
    case.write_text(CASE)
    solver.write_text(SOLVER)
    for f in (case, solver):
        checked = nsbench("check", str(f), cwd=tmp_path)
        assert checked.returncode == 0, checked.stdout + checked.stderr
    r = nsbench(
        "run",
        "--cases",
        str(case),
        "--solvers",
        str(solver),
        "-s",
        "my_solver",
        "-s",
        "pbd",
        "-o",
        "out",
        "-j",
        "1",
        cwd=tmp_path,
    )
    assert r.returncode == 0, r.stdout + r.stderr
    page = (tmp_path / "out" / "report.html").read_text()
    assert "my_case" in page and "my_solver" in page
    text = (tmp_path / "out" / "runs.csv").read_text()
    rows = list(csv.DictReader(text.splitlines()))
    assert text.count("my_case,my_solver,h") >= 18 and {row["status"] for row in rows} == {"ok"}


CASE = '''"""A point pulled onto the floor by a growing force.

    y' = -t + lam,   0 <= y _|_ lam >= 0,   y(0) = 1/2

Exact: y = 1/2 - t^2/2 up to t = 1, then rest with lam = t.
"""
import numpy as np
from nsbench import Affine, Case, Complementarity


def drift(xp):
    def f(t, y):
        return -t * xp.ones_like(y)
    return f


CASE = Case(
    name="my_case",
    problem=Complementarity(drift, (Affine(A=np.eye(1), b=np.zeros(1)),)),
    x0=np.array([0.5]),
    t=np.linspace(0.0, 2.0, 41),
    exact=lambda t: np.maximum(0.5 - t**2 / 2, 0.0)[:, None],
    exact_impulse=lambda t: (np.maximum(t, 1.0) ** 2 / 2 - 0.5)[:, None],
    exact_events=(1.0,),
)
'''

SOLVER = '''"""Euler, then clipping: for scenes with one floor per coordinate."""
from dataclasses import dataclass

import numpy as np

from nsbench.problem import Affine, Complementarity
from nsbench.solvers import Claims, Trajectory, grid


@dataclass(frozen=True)
class Clip:
    """Explicit Euler, then each coordinate clipped at its floor."""
    accuracy, default, claims = "h", 1e-2, Claims(state=1.0, impulse=1.0)

    def refuses(self, case):
        p = case.problem
        ok = isinstance(p, Complementarity) and len(p.constraints) == 1 and isinstance(p.constraints[0], Affine)
        if not ok or p.constraints[0].shape != (case.n, case.n):
            return "Clip needs one floor for every coordinate and nothing else."

    def prepare(self, case, h):
        g, f = grid(case.t, h), case.problem.drift(np)

        def run():
            x, total, X, I = case.x0.copy(), np.zeros(case.n), [case.x0], [np.zeros(case.n)]
            for k, n in enumerate(g.substeps):
                step = (g.t[k + 1] - g.t[k]) / n
                for s in range(n):
                    y = x + step * f(g.t[k] + s * step, x)
                    x = np.maximum(y, 0.0)
                    total = total + (x - y)
                X.append(x)
                I.append(total)
            ids = tuple((0, i) for i in range(case.n))
            return Trajectory(case.t, np.array(X), ids, np.array(I), np.array(I), stats={"h": g.h}, lam_time="end")
        return run


SOLVER = Clip
'''


def test_a_player_of_a_default_accuracy_is_written(tmp_path):
    page = tmp_path / "tide.html"
    assert main(["show", "three_discs", "-s", "pbd", "--html", str(page)]) == 0
    assert page.stat().st_size > 0


def test_a_reference_that_is_not_there_is_told_with_the_folder(tmp_path, capsys):
    assert main(["reference", "list", "tide", "--into", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert f"has no stored reference in {tmp_path}" in said and "--into" in said
