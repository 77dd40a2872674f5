"""A run that went well once and not when it was repeated to be timed is told as that, and nobody
else loses a number."""

import pytest
from solver_file import solver

import nsbench
from nsbench import solvers
from nsbench.execute.workers.pool import run_all
from nsbench.measure import clock
from nsbench.solvers import registry
from nsbench.study import Spec
from nsbench.study.attempt import REPEATED, _files_loaded, run_batch

SECOND = solver(
    """
    global CALLS
    CALLS += self.how != "fine"
    if self.how == "raise" and CALLS > 1:
        raise RuntimeError("the second call")
    if self.how == "memory" and CALLS > 1:
        raise MemoryError("the second call")
    if self.how == "exit" and CALLS > 1:
        print("the second call", flush=True)
        os._exit(9)
    if self.how == "meddle" and CALLS > 1:
        np.seterr(all="raise")
        warnings.simplefilter("error")
        os.environ["OMP_NUM_THREADS"] = "nonsense"
        os.chdir("/")
    if self.how in ("look", "sea"):
        warnings.warn("careful")
        np.log(np.zeros(1))
        int(os.environ["OMP_NUM_THREADS"])
        assert os.getcwd() != "/"
    if self.how == "hang" and CALLS > 1:
        time.sleep(1000)
""",
    before="from nsbench.measure import clock\nclock.LONG = 5.0      # runs are quick, however "
    "busy the machine is\nCALLS = 0\n",
)


@pytest.fixture(autouse=True)
def what_is_quick(monkeypatch):
    monkeypatch.setattr(
        clock, "LONG", clock.LONG
    )  # the file above, loaded here, changes it for one test


def specs_of(tmp_path, *hows):
    path = tmp_path / "second.py"
    path.write_text(SECOND)
    return [
        Spec("tide", f"second[how={how}]" if how != "pbd" else "pbd", "h", 0.01, "", (str(path),))
        for how in hows
    ]


def last_rows(specs, **more):
    """The row of each run that counts, the last one, by what the run does; how many it was
    given."""
    rows = {}
    given = {}

    def on_row(spec, row):
        rows[spec] = row
        given[spec] = given.get(spec, 0) + 1

    run_all([specs], 1, 3.0, on_row, **more)
    return [rows[s] for s in specs], [given[s] for s in specs]


@pytest.mark.long
@pytest.mark.survives("a repetition")
@pytest.mark.parametrize(
    "how, status", [("raise", "error"), ("memory", "oom"), ("exit", "crashed"), ("hang", "timeout")]
)
def test_a_repetition_that_fails_is_a_row_and_the_others_are_timed(tmp_path, how, status):
    rows, _ = last_rows(specs_of(tmp_path, "pbd", how, "fine"))
    assert [r["status"] for r in rows] == ["ok", status, "ok"]
    assert REPEATED in rows[1]["why"] and len(rows[1]["why"]) > len(REPEATED) + 10
    assert rows[0]["rounds"] >= 3 and rows[2]["rounds"] >= 3 and rows[1].get("rounds", 1) == 1
    if how == "exit":
        assert "The last it printed: the second call" in rows[1]["why"]


@pytest.mark.long
@pytest.mark.survives("a repetition", "death")
def test_a_death_costs_those_before_it_no_times_whether_or_not_it_had_a_row(tmp_path):
    rows, given = last_rows(specs_of(tmp_path, "pbd", "fine", "exit", "hang"))
    assert [r["status"] for r in rows] == ["ok", "ok", "crashed", "timeout"]
    assert rows[0]["rounds"] >= 3 and rows[1]["rounds"] >= 3
    assert max(given) <= 6


@pytest.mark.survives("a repetition", "global state")
def test_a_repetition_does_not_see_what_the_one_before_it_has_changed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rows, _ = last_rows(specs_of(tmp_path, "look", "meddle", "sea"))
    assert [r["status"] for r in rows] == ["ok"] * 3, [r["why"] for r in rows]
    assert min(r["rounds"] for r in rows) >= 3 and [r["warnings"] for r in rows] == [2, 0, 2]


@pytest.mark.survives("a repetition")
def test_a_repetition_that_raises_costs_a_study_nothing_else(tmp_path):
    specs = specs_of(tmp_path, "pbd", "raise", "fine")
    rows = dict(run_batch(specs))
    assert [rows[i]["status"] for i in range(3)] == [
        "ok",
        "error",
        "ok",
    ] and "the second call" in rows[1]["why"]
    assert rows[0]["rounds"] >= 3 and rows[2]["rounds"] >= 3
    registry._loaded.pop("second")
    _files_loaded.clear()
    solvers.load(specs[1].solver_files[0])
    found = nsbench.run("tide", ["pbd", "second[how=raise]"], h=0.01)
    assert [r["status"] for r in found.rows] == ["ok", "error"] and found.rows[0]["rounds"] >= 3


@pytest.mark.survives("ok is finite")
@pytest.mark.parametrize(
    "parts, word",
    [
        ("(), np.zeros((k, 0)), np.zeros((k, 1)), stats=None", "stats"),
        ("None, np.zeros((k, 0)), np.zeros((k, 1))", "contacts"),
        ("(), [[0.0], [0.0, 1.0]], np.zeros((k, 1))", "measuring it did not"),
        ("(), np.zeros((k, 0)), np.zeros((k, 1)), Status('nan', 'no'), stats=None", "stats"),
        ("(), np.zeros((k, 0)), np.zeros((k, 1)), stats={1: 'a', 'h': 0.1}", ""),
    ],
)
def test_whatever_a_solver_returns_is_a_row(tmp_path, parts, word):
    path = tmp_path / "odd.py"
    path.write_text(
        solver(f"k = len(case.t)\nreturn Trajectory(case.t, np.tile(case.x0, (k, 1)), {parts})")
    )
    row = dict(run_batch([Spec("tide", "odd", "h", 0.1, "", (str(path),))]))[0]
    assert row["status"] == ("error" if word else "ok") and word in row["why"]
