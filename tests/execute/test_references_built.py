"""`nsbench run` of a user's case builds the reference that it lacks, or says why there is none."""

import csv

import numpy as np
import pytest

import nsbench
from nsbench.cli import main
from nsbench.reference import build_missing, is_missing, why_missing
from nsbench.report.data import read
from nsbench.report.overview import format_overview
from nsbench.report.summary import summarise
from nsbench.report.verdict import write_verdict
from nsbench.study.plan import resolve

DECAY = '''"""A point pulled onto a floor: y' = -(1 + rate t) + lam, 0 <= y _|_ lam >= 0."""
import numpy as np
from nsbench import Affine, Case, Complementarity

SUITES = {"standard": [{}, {"rate": 0.5}]}


def make(rate: float = 0.25):
    def drift(xp):
        return lambda t, y: -(1.0 + rate * t) * xp.ones_like(y)

    floor = Affine(np.eye(1), np.zeros(1))
    problem = Complementarity(drift, (floor,))
    return Case(name="mine", problem=problem, x0=[0.5], t=np.linspace(0.0, 1.0, 11))
'''

def truth(t, rate):
    """Closed form of the first file, which the builder does not know."""
    return np.maximum(0.5 - t - rate * t**2 / 2, 0.0)[:, None]


def case_from(tmp_path, text):
    (tmp_path / "mine.py").write_text(text)
    case = nsbench.load_case(tmp_path / "mine.py")
    return case.replace(references=str(tmp_path / "references"))


@pytest.mark.parametrize("rate", [0.25, 0.5])
def test_a_reference_that_is_built_is_within_its_bound_of_the_truth(tmp_path, rate):
    case = case_from(tmp_path, DECAY.replace("= 0.25", f"= {rate}"))
    assert is_missing(case)
    build_missing(case)
    assert not is_missing(case) and (tmp_path / "references" / "mine.npz").exists()
    ref = nsbench.reference.reference(case)
    assert np.abs(ref.x - truth(case.t, rate)).max() <= ref.state_error + 1e-16


def test_a_case_that_was_edited_gets_another_reference(tmp_path):
    build_missing(case_from(tmp_path, DECAY))
    edited = case_from(tmp_path, DECAY.replace("= 0.25", "= 0.75"))
    assert is_missing(edited)
    build_missing(edited)
    ref = nsbench.reference.reference(edited)
    assert np.abs(ref.x - truth(edited.t, 0.75)).max() <= ref.state_error + 1e-16


def test_a_case_without_a_reference_has_a_reason_and_errors_that_are_not_known(tmp_path):
    """Events accumulate in a spiral: event_driven ends there, Euler does not."""
    known = nsbench.get_case("spiral")
    forgets = dict.fromkeys(("exact", "exact_impulse", "exact_events"))
    case = known.replace(references=str(tmp_path / "references"), **forgets)
    build_missing(case)
    why = why_missing(case)
    assert "event_driven" in why and "chatter" in why, why
    assert not is_missing(case)  # nobody tries again until the case is another
    study = nsbench.run(case, ["euler"], h=np.geomspace(0.1, 0.01, 18))
    assert {row["reference"] for row in study.rows} == {"none"}
    data = read(study)
    said = str(write_verdict(data, summarise(data)))
    assert "Errors are not known" in said and why[:40] in said, said
    assert "reached by no method" not in said
    assert "not known" in "".join(format_overview(data))


@pytest.mark.long
def test_a_run_builds_what_is_missing_in_a_worker_and_keeps_it(tmp_path, monkeypatch, capsys):
    (tmp_path / "mine.py").write_text(DECAY)
    monkeypatch.chdir(tmp_path)
    args = ["run", "mine.py", "-s", "pbd", "--h", "5e-2..5e-3", "-j", "1", "-o", "out"]
    assert main([*args, "--plan", "--probe", "0"]) == 0
    assert "the references of mine, mine[rate=0.5] would be built" in capsys.readouterr().out
    assert not (tmp_path / "out" / "references").exists()
    assert main(args) == 0
    said = capsys.readouterr().out
    assert "building the references of mine, mine[rate=0.5]" in said
    assert "mine: reference: " in said and "mine[rate=0.5]: reference: " in said
    with open("out/runs.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["case"] for row in rows} == {"mine", "mine[rate=0.5]"}
    assert {row["reference"] for row in rows} <= {"certified", "stored"}
    assert all(float(row["state_sup"]) > 0 for row in rows)
    resolve.cache_clear()
    assert main(args) == 0
    assert "building" not in capsys.readouterr().out
    args = ["reference", "verify", "mine.py[rate=0.5]", "--into", "out/references"]
    assert main(args) == 0
    assert "mine[rate=0.5]: confirmed by" in capsys.readouterr().out


OVERLAP = DECAY.replace("x0=[0.5]", "x0=[-0.5]").replace('name="mine"', 'name="below"')


def test_a_start_that_is_not_feasible_ends_the_command_before_its_runs(
    tmp_path, monkeypatch, capsys, runs_here
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(DECAY)
    (tmp_path / "below.py").write_text(OVERLAP.replace("{}, ", ""))
    assert main(["run", "below.py", "-s", "pbd"]) == 2
    told = "the start of below[rate=0.5] violates constraint (0, 0) by 0.5"
    assert told in capsys.readouterr().err
    assert not (tmp_path / "results").exists()
    assert main(["run", "below.py", "mine.py", "-s", "pbd", "--h", "0.1..0.02", "-j", "1"]) == 3
    said = capsys.readouterr().out
    assert "left out: below[rate=0.5]: the start of" in said and "mine" in said.splitlines()[-3]
    assert {key.partition("[")[0] for key in read(tmp_path / "results").case_keys} == {"mine"}
