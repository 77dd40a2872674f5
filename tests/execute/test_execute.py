"""Whatever becomes of a run, it is a row, and the others go on."""

import dataclasses
import itertools
import json
import os

import pytest
from solver_file import solver

from nsbench.cli import main
from nsbench.execute.workers.kernel_schedule import KernelSchedule, kernel_group
from nsbench.execute.workers.pool import Chore, run_all
from nsbench.measure import clock
from nsbench.study import Spec
from nsbench.study.attempt import attempt, run_batch
from nsbench.study.plan import substeps_ladder

SOLVER = solver(
    """
    if self.how == "hang":
        while True:
            np.linalg.svd(np.ones((300, 300)))
    if self.how == "exit":
        os._exit(7)
    if self.how == "raise":
        raise RuntimeError("on purpose")
    if self.how == "memory":
        raise MemoryError("on purpose")
    if self.how == "wordless":
        raise Wordless
""",
    how="hang",
    before="""
class Wordless(Exception):
    def __str__(self):
        raise TypeError("no text")

""",
)


@pytest.mark.long
@pytest.mark.survives("hang", "death", "memory")
def test_hang_exit_and_exception_are_rows_and_the_others_go_on(tmp_path):
    file = tmp_path / "bad.py"
    file.write_text(SOLVER)
    specs = [
        Spec("tide", f"bad[how={how}]", "h", 0.01, "", (str(file),))
        for how in ("fine", "hang", "raise", "exit", "memory", "fine2")
    ]
    rows = {}
    run_all(
        [specs, [Spec("tide", "pbd", "h", 0.01)]],
        2,
        2.0,
        lambda spec, row: rows.__setitem__(spec, row),
    )
    status = [rows[s]["status"] for s in specs]
    assert status == ["ok", "timeout", "error", "crashed", "oom", "ok"]
    assert (
        "2 s" in rows[specs[1]]["why"]
        and "code 7" in rows[specs[3]]["why"]
        and "on purpose" in rows[specs[2]]["why"]
    )
    assert rows[Spec("tide", "pbd", "h", 0.01)]["status"] == "ok"


def test_an_exception_whose_text_cannot_be_made_is_an_error_row(tmp_path):
    """Its __str__ raises; a worker that died of that was taken for one out of memory."""
    file = tmp_path / "bad.py"
    file.write_text(SOLVER)
    row, _ = attempt(Spec("tide", "bad[how=wordless]", "h", 0.01, "", (str(file),)))
    assert row["status"] == "error"
    assert "Wordless" in row["why"] and "__str__ raises TypeError" in row["why"]


@pytest.mark.survives("same bytes")
def test_rows_of_a_repeated_run_agree_to_the_byte():
    spec = Spec("tide", "pbd", "h", 0.01)
    times = (
        "seconds",
        "seconds_low",
        "seconds_high",
        "setup_seconds",
        "compile_seconds",
        "seconds_max",
        "rounds",
    )
    a, b = ({k: repr(v) for k, v in attempt(spec)[0].items() if k not in times} for _ in range(2))
    assert a == b


def test_quick_runs_are_timed_in_rounds_and_each_row_is_given_at_once(monkeypatch):
    monkeypatch.setattr(clock, "LONG", 5.0)  # quick, however busy the machine is
    specs = [Spec("tide", "pbd", "h", h) for h in (0.05, 0.025)]
    seen = list(run_batch(specs))
    assert [i for i, _ in seen] == [0, 1, 0, 1]
    first = seen[0][1]
    last = seen[2][1]
    assert first["rounds"] == 1 and 3 <= last["rounds"] <= 7
    assert last["seconds_low"] <= last["seconds"] <= last["seconds_high"] <= last["seconds_max"]


def test_refusal_is_a_row_with_a_sentence():
    row, run = attempt(Spec("sliding", "pbd", "h", 0.1))
    assert row["status"] == "refused" and len(row["why"].split()) > 3 and run is None


def test_ladder_has_enough_steps_over_enough_octaves_and_no_dyadic_rule():
    for first in (1, 2, 3, 7, 40):
        n = substeps_ladder(first)
        assert len(n) >= 18 and n[-1] >= 64 * n[0] and len(set(n)) == len(n)
        ratios = {round(b / a, 6) for a, b in itertools.pairwise(n[8:])}
        assert len(ratios) > 3 and 2.0 not in ratios


def test_specs_are_plain_data():
    assert dataclasses.asdict(Spec("tide", "pbd", "h", 0.1))["asked"] == 0.1


def test_first_call_of_a_quick_run_is_no_part_of_its_clock(monkeypatch):
    from types import SimpleNamespace

    from nsbench import solvers

    calls = []
    now = [0.0]
    monkeypatch.setattr(clock, "time", SimpleNamespace(perf_counter=lambda: now[0]))
    method = solvers.get("pbd")

    class Slow:
        accuracy = method.accuracy
        default = method.default
        claims = method.claims

        def refuses(self, case):
            return None

        def prepare(self, case, h):
            now[0] += 0.2 if not calls else 0.02
            calls.append("prepare")
            run = method.prepare(case, h)

            def call():
                now[0] += 0.06 if calls.count("run") == 0 else 0.001
                calls.append("run")
                return run()

            return call

    monkeypatch.setattr(solvers, "get", lambda spec: Slow())
    row = attempt(Spec("tide", "slow", "h", 0.05))[0]
    assert row["compile_seconds"] == pytest.approx(0.18) and row["setup_seconds"] == pytest.approx(
        0.02
    )
    calls[:] = ["prepare"]
    monkeypatch.setattr(clock, "LONG", 10.0)  # the first call would be long enough to be timed once
    last = list(run_batch([Spec("tide", "slow", "h", 0.05)]))[-1][1]
    assert last["rounds"] >= 3 and last["seconds_max"] == pytest.approx(0.001)


def test_rounds_begin_with_another_run_each_time_and_long_runs_are_timed_once():
    seen = []
    times = clock.in_rounds([lambda: None] * 3, [3, 3, 1], seen.append)
    assert [len(t) for t in times] == [3, 3, 1] and seen == [0, 1, 2, 1, 0, 0, 1]
    assert [clock.rounds_of(s) for s in (1e-6, 0.006, 0.015, 0.04, 0.4)] == [7, 5, 3, 3, 1]


def test_no_two_workers_compile_the_same_kernels_at_once(tmp_path):
    specs = [
        Spec("tide", "pbd", "h", 0.1),
        Spec("tide", "euler", "h", 0.1),
        Spec("tide", "pbd[sweeps=2]", "h", 0.1),
    ]
    one = KernelSchedule(str(tmp_path)).order(specs)
    other = KernelSchedule(str(tmp_path)).order(specs)
    assert next(one)[0] == 0 and next(other)[0] == 1  # the second leaves pbd to the first
    assert next(one)[0] == 2  # which has let it go with its next run
    assert [i for i, _ in other] == [0, 2] and [i for i, _ in one] == [1]
    assert sorted(i for i, _ in KernelSchedule(str(tmp_path)).order(specs)) == [0, 1, 2]


def test_specs_with_other_families_need_other_kernels():
    words = {
        kernel_group(Spec(c, s, "h", 0.1))
        for c, s in (
            ("tide", "pbd"),
            ("three_discs", "pbd"),
            ("sliding", "euler"),
            ("tide", "pbd[order=reverse]"),
        )
    }
    assert len(words) == 3


@pytest.mark.long
def test_chores_are_done_and_one_that_fails_or_dies_costs_nothing_else(tmp_path):
    file = tmp_path / "bad.py"
    file.write_text(SOLVER)
    rows = []
    last = Spec("tide", "bad[how=exit]", "h", 0.01, "", (str(file),))
    chores = [Chore(os.makedirs, (str(tmp_path / n),)) for n in "ab"]
    chores += [Chore(os.makedirs, (str(tmp_path),)), Chore(os._exit, (3,))]
    done = run_all(
        [[last], [Spec("tide", "pbd", "h", 0.01)]],
        1,
        20.0,
        lambda s, row: rows.append(row["status"]),
        chores,
    )
    assert rows[0] == "crashed" and set(rows[1:]) == {
        "ok"
    }  # a death in the last run of a batch: the next goes on
    assert done == chores[:2] and (tmp_path / "a").is_dir() and (tmp_path / "b").is_dir()


def test_the_longest_batches_come_first_and_the_second_needs_other_kernels():
    from nsbench.execute.forecast import work
    from nsbench.execute.suite import order_batches

    quick = [Spec("tide", "pbd", "h", 0.1)]
    free = [Spec("sliding", "euler", "h", 0.1)]
    long = [Spec("discs[n=30]", "pbd", "h", 1e-4)]
    python = [Spec("tide", "catching_up[backend=osqp]", "h", 1e-3)]
    assert work(quick[0]) < work(python[0]) and work(quick[0]) < work(long[0])
    assert work(Spec("sliding", "pbd", "h", float("nan"))) == 0.0
    assert (
        order_batches([quick, free, long])[:2] == [long, free]
        and len(order_batches([quick, free, long, python])) == 4
    )
    assert order_batches([quick, python]) == [python, quick]
    variant = [Spec("discs[n=10]", "pbd", "h", 1e-4)]
    short = [Spec("hex", "pbd", "h", 1e-2)]
    assert work(long[0]) > work(variant[0]) > work(short[0])
    assert order_batches([short, variant, long]) == [long, short, variant] and order_batches(
        [variant, long]
    ) == [long, variant]


def test_what_shares_a_solver_waits_its_turn_and_is_taken_after(tmp_path):
    """Other families need more kernels of the same solver: they are not compiled beside it."""
    one = KernelSchedule(str(tmp_path)).order([Spec("tide", "pbd", "h", 0.1)])
    other = KernelSchedule(str(tmp_path)).order(
        [Spec("three_discs", "pbd", "h", 0.1), Spec("three_discs", "penalty", "k", 9.0)]
    )
    assert next(one)[0] == 0 and next(other)[0] == 1
    one.close()
    assert [i for i, _ in other] == [0]


def test_a_kernel_compiled_within_a_run_stops_its_clock():
    from nsbench.execute.workers.pool import exceeded_limit
    from nsbench.execute.workers.process import Worker
    from nsbench.execute.workers.worker import Messages

    sent = []

    class Pipe:
        def send(self, message):
            sent.append(message)

    messages = Messages(Pipe())
    messages.announce("run", 3)
    with messages.announce_compilation():
        pass
    assert sent == [("run", 3, None), ("compile", 3, None), ("run", 3, None)]
    assert exceeded_limit(Worker(None, None, phase="run", since=10.0), 2.0, 15.0) == 2.0
    assert exceeded_limit(Worker(None, None, phase="compile", since=10.0), 2.0, 15.0) is None


@pytest.mark.long
def test_a_player_shows_runs_of_the_study(tmp_path):
    """The runs are made again by a worker: their seconds are in the rows."""
    out = tmp_path / "r"
    solvers = ["-s", "pbd", "-s", "euler"]
    assert main(["run", "tide", *solvers, "--h", "0.05,0.02", "-o", str(out)]) == 0
    found = json.loads((out / "figures" / "scene_tide.json").read_text(encoding="utf-8"))
    shown = [(run["solver"], run["asked"]) for run in found["runs"]]
    assert shown == [("pbd", 0.05), ("pbd", 0.02)]
    assert 'class="player' in (out / "report.html").read_text(encoding="utf-8")
