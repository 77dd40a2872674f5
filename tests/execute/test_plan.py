"""A plan says what would run and why, foresees time and memory, and what is too large is refused
before it is made."""

import argparse
import dataclasses
import subprocess
import sys
import time

import numpy as np
import pytest

import nsbench
from nsbench import get_case
from nsbench.case import size
from nsbench.cli import main
from nsbench.execute import dry_run
from nsbench.execute.dry_run import NEW, NEW_ACCURACY, Plan, rerun_reasons
from nsbench.execute.forecast import (
    COLD_COMPILATION,
    GUESS,
    JOURNAL,
    NOTHING,
    Forecast,
    seconds_with_repetitions,
    select_probes,
    timing_seconds,
)
from nsbench.execute.probe import probe
from nsbench.results import run_key
from nsbench.results.journal import Journal, read_journal, settled
from nsbench.results.run_key import Part
from nsbench.study import Spec
from nsbench.study.plan import hand_over, plan_runs

HANG = '''
import time
from dataclasses import dataclass
from nsbench.solvers import Claims
@dataclass(frozen=True)
class Hang:
    """Hangs."""
    accuracy, default, claims = "h", 0.01, Claims()
    def refuses(self, case):
        return None
    def prepare(self, case, h):
        time.sleep(1000.0)
SOLVER = Hang
'''


@pytest.mark.survives("giant")
@pytest.mark.parametrize(
    "case, pairs",
    [
        ("discs[n=1e9]", "5e+17"),
        ("discs[n=1000000000,box=true]", "5e+17"),
        ("stack[n=50000000]", "1.25e+15"),
        ("epithelium[n=100000]", "5e+09"),
    ],
)
def test_a_giant_scene_is_refused_with_its_size_before_it_is_made(case, pairs, capsys, tmp_path):
    start = time.process_time()
    assert main(["run", case, "-s", "pbd", "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert (
        case in said and f"{pairs} pairs" in said and "iB of memory" in said and "--memory" in said
    )
    for command in (
        ["show", case],
        ["reference", "verify", case],
        ["reference", "build", case, "--into", str(tmp_path)],
    ):
        assert main(command) == 2
        assert f"{pairs} pairs" in capsys.readouterr().err, command
    assert time.process_time() - start < 4.0 and not (tmp_path / "out").exists()


@pytest.mark.survives("giant")
def test_the_limit_can_be_given_and_holds_for_cases_of_any_size(capsys, tmp_path):
    assert main(["run", "discs[n=10]", "-s", "pbd", "-o", str(tmp_path), "--memory", "100M"]) == 2
    assert "45 pairs" in capsys.readouterr().err
    args = argparse.Namespace(memory=1 << 60, jobs=1)
    dry_run.check_memory({"discs[n=1e9]": size.predicted_size("discs[n=1e9]")}, args)
    assert size.predicted_size("discs[n=30]") is None and size.predicted_size("tide") is None


@pytest.mark.parametrize("case", ["discs[n=40000]", "discs[n=30000,box=true]", "stack[n=20000]"])
def test_a_size_is_foreseen_as_it_comes_out(case):
    ahead = size.predicted_size(case)
    made = size.size_of(get_case(case))
    for name in ("states", "samples", "contacts", "particles"):
        assert getattr(ahead, name) == pytest.approx(getattr(made, name), rel=0.15)


def journal(folder, spec, parts, **row):
    j = Journal(folder)
    j.append(
        run_key.key_of(spec, parts),
        {
            "case": spec.case,
            "solver": spec.solver,
            "accuracy": spec.accuracy,
            "asked": spec.asked,
            "status": "ok",
        }
        | row,
        parts,
    )
    j.close()


def why(folder, spec, parts, force=False):
    key = run_key.key_of(spec, parts)
    known = {k: r for k, r in read_journal(folder).items() if settled(r, 120.0)}
    plan = Plan([spec], {}, {spec: parts}, {spec: key}, known, folder)
    return rerun_reasons(plan, force)[spec]


@pytest.mark.survives("stale")
def test_every_reason_to_run_again_is_told(tmp_path):
    spec = Spec("tide", "pbd", "h", 0.1)
    case = get_case("tide")
    parts = run_key.parts_of(spec, case)
    assert why(tmp_path, spec, parts) == NEW
    journal(tmp_path, spec, parts)
    assert why(tmp_path, spec, parts) == "" and why(tmp_path, spec, parts, force=True) == "forced"
    assert why(tmp_path, dataclasses.replace(spec, asked=0.2), parts) == NEW_ACCURACY
    assert why(tmp_path, dataclasses.replace(spec, solver="pbd[sweeps=2]"), parts) == NEW

    def changed(**items):
        return tuple(Part.of({k: items.get(k, v) for k, v in p.items}) for p in parts)

    assert why(tmp_path, spec, changed(nsbench="0")) == "nsbench changed"
    assert (
        why(tmp_path, spec, changed(**{"nsbench/cases/tide.py": "0"}))
        == "nsbench/cases/tide.py changed"
    )
    assert why(tmp_path, spec, changed(numpy="0.1")) == f"numpy {np.__version__} -> 0.1"
    more = (
        *parts[:2],
        Part.of(dict(parts[2].items) | {"beside.py": "1", "setting JAX_ENABLE_X64": "0"}),
    )
    assert why(tmp_path, spec, more) == "beside.py is used now; setting JAX_ENABLE_X64 none -> 0"
    journal(tmp_path, spec, parts, status="crashed")
    assert why(tmp_path, spec, parts) == "ended with crashed"


def test_a_plan_groups_runs_and_writes_nothing(tmp_path, capsys):
    out = tmp_path / "out"
    command = ["run", "tide", "sliding", "-s", "pbd", "--plan", "--probe", "0", "-o", str(out)]
    assert main(command) == 0
    said = capsys.readouterr().out
    assert (
        "20 to run, 0 known" in said
        and "1 of them is a refusal" in said
        and "forecast:" in said
        and "guess" in said
    )
    assert said.count("pbd") == 1 and not out.exists()
    assert main([*command, "-v"]) == 0 and capsys.readouterr().out.count("run    tide pbd h=") == 19


def test_a_plan_loads_neither_jax_nor_numba(tmp_path):
    code = (
        "from nsbench.cli import main; import sys; main(['run', 'tide', 'discs[n=3]', '--plan', "
        "'--probe', '0', '-o', "
        f"{str(tmp_path)!r}]); print({{'jax', 'numba', 'pandas', 'pyarrow', 'distributed'}} & "
        f"{{*sys.modules}})"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "set()"


def row(asked, seconds, case="tide", solver="pbd", accuracy="h"):
    return {
        "case": case,
        "solver": solver,
        "accuracy": accuracy,
        "asked": asked,
        "seconds": seconds,
        "setup_seconds": 0.0,
        "compile_seconds": 0.0,
    }


@pytest.mark.parametrize("accuracy, power", [("h", -1.0), ("h", -1.5), ("tol", -0.2), ("k", 0.5)])
def test_seconds_follow_a_power_that_is_fitted(accuracy, power):
    asked = np.geomspace(1e-1, 1e-2, 5) if accuracy != "k" else np.geomspace(1e2, 1e3, 5)
    forecast = Forecast(
        [row(float(a), float((a / asked[0]) ** power), accuracy=accuracy) for a in asked]
    )
    far = 1e-4 if accuracy != "k" else 1e5
    spec = Spec("tide", "pbd", accuracy, far)
    assert forecast.cost(spec).source == JOURNAL
    assert forecast.seconds(spec) == pytest.approx((far / asked[0]) ** power, rel=0.02)


def test_the_part_of_a_run_that_has_no_steps_is_told_apart():
    """1 ms and 1 us a step: finer steps, and another case of the same length, from two runs."""
    seconds = lambda h: 1e-3 + 1e-6 / h
    forecast = Forecast([row(h, seconds(h)) for h in (1e-2, 3e-3)])
    assert forecast.seconds(Spec("tide", "pbd", "h", 1e-5)) == pytest.approx(seconds(1e-5))
    apple = nsbench.get_case("apple")
    span = (apple.t[-1] - apple.t[0]) / np.ptp(nsbench.get_case("tide").t)
    guess = forecast.seconds(Spec("apple", "pbd", "h", 1e-5))
    assert guess == pytest.approx(1e-3 + 1e-6 * span * apple.n * 1e5, rel=1e-6)


def test_what_is_not_known_is_taken_from_elsewhere_and_said_to_be():
    forecast = Forecast([row(1e-2, 3.0)])
    near, other = (forecast.cost(Spec(case, "pbd", "h", 1e-2)) for case in ("tide", "apple"))
    assert (
        near.source == JOURNAL
        and other.source == GUESS
        and 0.3 < other.seconds / near.seconds < 3.0
    )
    told = [
        row(1e-2, 1.0) | {"compile_seconds": 7.0},
        row(1e-3, 1.0),
        row(1e-2, 1.0, case="apple") | {"compile_seconds": 2.0},
    ]
    assert Forecast(told).compilation(["pbd", "pbd", "theta"]) == 7.0
    assert Forecast([]).cost(Spec("tide", "pbd", "h", float("nan"))).source == NOTHING


def test_a_method_with_nothing_on_the_disk_is_compiled_once_and_then_known(tmp_path, monkeypatch):
    """One method in two versions, and one that numba compiles nothing of."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    asked = ["pbd", "pbd[order=reverse]", "solve_ivp"]
    assert Forecast([]).compilation(asked) == COLD_COMPILATION
    monkeypatch.undo()
    nsbench.solve("tide", "pbd", h=0.1)
    assert Forecast([]).compilation(asked) == 0.0
    known = Forecast([row(1e-2, 1.0) | {"compile_seconds": 7.0}])
    assert known.compilation(["pbd"]) == 7.0
    cost = known.cost(Spec("tide", "pbd", "h", 2e-2))
    assert cost.timing == timing_seconds(known.seconds(Spec("tide", "pbd", "h", 2e-2)))


def test_rounds_of_quick_runs_are_made_by_one_process():
    assert timing_seconds(1e-3) == pytest.approx(7e-3) and timing_seconds(0.2) == 0.0
    assert seconds_with_repetitions(1e-3, 0.0) == pytest.approx(8e-3)


@pytest.mark.long
def test_small_runs_are_made_apart_and_stopped_in_time(tmp_path):
    file = tmp_path / "hang.py"
    file.write_text(HANG)
    specs = [
        Spec("tide", s, "h", h, "", (str(file),))
        for s in ("solve_ivp", "hang", "pbd")
        for h in (0.05, 0.01, 0.002)
    ]
    chosen = select_probes(specs)
    assert {s.solver for s in chosen[:5:2]} == {"solve_ivp", "hang", "pbd"} and len(chosen) == 6
    start = time.monotonic()
    assert not probe([specs[3]], 3.0) and time.monotonic() - start < 6.0
    (found,) = probe(
        [
            Spec("tide", "euler", "h", float("nan")),
        ],
        60.0,
    ).values()
    assert found["status"] == "refused" and found["wall"] >= 0.0 and found["memory"] > 1 << 24


def test_circuits_are_run_with_the_trapezoidal_rule_too():
    circuit = nsbench.LCS(A=[[-1.0]], B=[[1.0]], C=[[1.0]], D=[[1.0]])
    case = nsbench.Case("own", circuit, np.ones(1), np.linspace(0.0, 1.0, 5))
    for cases in ([("rlc_diode", "")], [(case.key, hand_over(case))]):
        asked = [s.solver for s in plan_runs(cases, None)]
        assert asked.count("theta[theta=0.5]") == asked.count("theta") > 10
    assert "theta[theta=0.5]" not in {s.solver for s in plan_runs([("sliding", "")], None)}
