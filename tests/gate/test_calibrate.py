"""Tolerances come from runs that differ in nothing that matters, and a calibrated study is held by
its own baseline."""

import argparse
import contextlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import nsbench
from nsbench import study
from nsbench.cli import main
from nsbench.dynamics.scaling.estimate import case_scale
from nsbench.gate import baseline, calibrate, spreads
from nsbench.gate.calibrate import _ended_otherwise, specs_of
from nsbench.gate.facts import Fact
from nsbench.report.data import read
from nsbench.results import tables
from nsbench.results.journal import Journal, read_journal
from nsbench.study.attempt import START_PERTURBATION, attempt, perturbed_start


def test_a_nudged_start_is_near_and_the_same_for_the_same_seed():
    case = nsbench.get_case("three_discs")
    a, b, c = (perturbed_start(case, seed).x0 for seed in (1, 1, 2))
    size = np.maximum(case_scale(case).state, np.abs(case.x0))
    assert perturbed_start(case, 0) is case and np.array_equal(a, b) and not np.array_equal(a, c)
    assert 0.0 < np.max(np.abs(a - case.x0) / size) <= START_PERTURBATION


def test_nudged_runs_are_measured_against_the_solution_from_the_own_start():
    plain, away = (
        attempt(study.Spec("three_discs", "pbd", "h", 0.01, start_seed=seed)) for seed in (0, 1)
    )
    assert away[1] is None, "a nudged run is not timed"
    assert (
        away[0]["status"] == "ok" and 0.0 < abs(plain[0]["state_sup"] - away[0]["state_sup"]) < 1e-9
    )


def test_a_calibrated_study_is_held_by_its_own_baseline(tmp_path, capsys, runs_here):
    out = tmp_path / "r"
    base = tmp_path / "base.csv"
    assert (
        main(["run", "tide", "-s", "pbd", "--h", "0.05,0.03,0.02", "-o", str(out), "-j", "1"]) == 0
    )
    assert main(["calibrate", str(out), "-j", "1"]) == 0
    found = spreads.read(out)
    assert 0.0 < max(found.values()) < 1e-10 and found["tide", "pbd", "h=0.03", "steps"] == 0.0
    assert main(["gate", str(out), "--baseline", str(base), "--update", "--reason", "first"]) == 0
    assert main(["gate", str(out), "--baseline", str(base)]) == 0
    lines = baseline.read(base)
    assert {x.config.split()[0] for x in lines.values()} == {
        next(iter(lines.values())).config.split()[0]
    }
    assert "case=" in next(iter(lines.values())).config and all(x.held for x in lines.values())
    capsys.readouterr()
    assert (
        main(["calibrate", str(out), "-j", "1"]) == 0 and "pass 3 of 3" in capsys.readouterr().out
    )
    again = Path(out, "calibration", "1")
    key, row = next(iter(read_journal(again).items()))
    with contextlib.closing(
        Journal(again)
    ) as journal:  # a machine that was short of memory is not so for ever
        journal.append(
            key,
            {k: row[k] for k in ("case", "solver", "accuracy", "asked")}
            | {"status": "oom", "why": "Once."},
        )
    assert (
        main(["calibrate", str(out), "-j", "1"]) == 0
        and read_journal(again)[key]["status"] == row["status"]
    )
    assert spreads.read(out) == found


def test_a_study_of_cases_that_are_not_registered_cannot_be_calibrated(tmp_path):
    from report_rows import row

    from nsbench.gate.calibrate import calibrate

    tables.write_tables(tmp_path, [row("nowhere", "pbd", 0.1)])
    assert specs_of(read(tmp_path)) == []
    with pytest.raises(LookupError, match="no run of a known case"):
        calibrate(tmp_path, argparse.Namespace(jobs=1, timeout=10.0), print)


def test_a_run_that_ends_otherwise_from_a_start_beside_is_told_with_its_reason():
    from report_rows import row

    kept = [row("tide", "pbd", h) for h in (0.05, 0.03)]
    lost = row("tide", "pbd", 0.03, status="degenerate", why="No motion continues.")
    said = _ended_otherwise(read(kept), read([kept[0], lost]), "starts 1e-12 apart, 1")
    assert list(said) == [("tide", "pbd")]
    assert said["tide", "pbd"] == (
        "tide pbd: 1 run ended otherwise in the pass 'starts 1e-12 apart, 1', not to be held; the "
        "first (h = 0.0303): degenerate No motion continues."
    )
    assert not _ended_otherwise(read(kept), read(kept), "")
    refused = [row("sliding", "pbd", float("nan"), status="refused", why="It has no constraints.")]
    assert not _ended_otherwise(read(refused), read(refused), "")


def test_what_ends_otherwise_in_a_pass_is_said_once_with_the_first_reason(tmp_path, monkeypatch):
    from report_rows import row

    kept = [row("tide", "pbd", h) for h in (0.05, 0.03)]
    (tmp_path / "out").mkdir()
    tables.write_tables(tmp_path / "out", kept)
    reasons = iter(["No motion continues.", "Another.", ""])

    def again(specs, folder, threads, args, data):
        why = next(reasons)
        status = "degenerate" if why else "ok"
        return read([kept[0], row("tide", "pbd", 0.03, status=status, why=why)])

    monkeypatch.setattr(calibrate, "_again", again)
    said = []
    calibrate.calibrate(tmp_path / "out", None, said.append)
    assert sum("1 run ended otherwise in the pass 'starts 1e-12 apart, " in s for s in said) == 1
    assert any("No motion continues." in s for s in said)
    assert not any(s.startswith("not to be held: ") for s in said)


def test_no_two_passes_have_the_same_starts():
    assert len({*calibrate.SEEDS, 0}) == len(calibrate.SEEDS) + 1 >= 3


def test_spreads_are_distances_and_what_one_study_lacks_has_no_bound():
    fact = Fact("tide", "pbd", "h=0.01", "state_sup", "near", 0.25, "", "")
    count = replace(fact, metric="steps", kind="count", value=300.0)
    word = replace(fact, parameters="ladder", metric="statuses", kind="class", value="19 ok")
    other = {fact.key: replace(fact, value=0.26), word.key: replace(word, value="18 ok")}
    got = spreads.spreads({f.key: f for f in (fact, count, word)}, [other])
    assert got == {fact.key: pytest.approx(0.01), count.key: float("inf"), word.key: float("inf")}
    assert spreads.spreads({fact.key: fact}, []) == {fact.key: 0.0}


HEAD = "case,solver,parameters,metric,spread,config\n"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "case,solver\n",
        f"{HEAD}a,b,c,d,nan,\n",
        f"{HEAD}a,b,c,d,-1,\n",
        f"{HEAD}a,b,c,d\n",
        f"{HEAD}a,b,c,d,0.1\n",
    ],
)
def test_a_spoilt_calibration_is_an_error_that_names_the_file(tmp_path, text):
    (tmp_path / "calibration.csv").write_text(text)
    with pytest.raises(ValueError, match=r"calibration\.csv"):
        spreads.read(tmp_path)
