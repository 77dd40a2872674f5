"""A cluster gives the rows that this machine gives, whatever becomes of its workers, and keeps
little of them here."""

import dataclasses
import os
import signal
import sys
import threading
import time
from pathlib import Path

import pytest
from local_cluster import cluster
from solver_file import solver
from test_execute import SOLVER

from nsbench import columns
from nsbench.cli import main
from nsbench.execute.cluster import client as far
from nsbench.execute.cluster import remote_worker
from nsbench.execute.workers import pool
from nsbench.results import run_key
from nsbench.results.journal import Journal, read_journal
from nsbench.study import Spec
from nsbench.study.attempt import run_one

LIMIT = 3.0  # seconds, of runs that take some milliseconds where nothing else is at work
CLOCK = {*columns.names("clock")}
# a nanny whose worker dies while it still starts gives it up: the run lets it start
KILLER = SOLVER.replace(
    'if self.how == "exit":',
    'if self.how == "kill":\n                time.sleep(2)\n'
    "                os.kill(os.getppid(), 9)\n"
    '            if self.how == "exit":',
)


@pytest.fixture(scope="module")
def address():
    with cluster(2, DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="1") as (where, _):
        yield where


def plain(row):
    return {k: repr(v) for k, v in row.items() if k not in CLOCK}


def pids(address):
    with far.connect_client(address) as client:
        return [*client.run(os.getpid).values()]


@pytest.mark.long
def test_rows_are_those_of_this_machine_though_a_worker_is_killed(address):
    steps = [0.05 / n for n in (1, 2, 3, 5, 8, 13, 21)]
    batches = [
        [Spec(c, s, "h", h) for s in ("pbd", "euler") for h in steps] for c in ("tide", "sliding")
    ]
    before = pids(address)
    rows = {}

    def on_row(spec, row):
        assert row["shared"] is True and spec not in rows
        rows[spec] = plain(row)
        if len(rows) == 3:
            os.kill(before[0], signal.SIGKILL)

    far.run_all(iter(batches), address, 60.0, on_row)
    here = {}
    pool.run_all(batches, 1, 60.0, lambda spec, row: here.__setitem__(spec, plain(row)))
    assert rows == here and len(rows) == 28
    assert set(pids(address)) != set(before)


@pytest.mark.long
def test_hang_exit_and_exception_are_the_rows_they_are_here(address, tmp_path):
    file = tmp_path / "bad.py"
    file.write_text(SOLVER)
    specs = [
        Spec("tide", f"bad[how={how}]", "h", 0.01, "", (str(file),))
        for how in ("fine", "hang", "raise", "exit", "memory", "fine2")
    ]
    there = {}
    here = {}
    far.run_all([specs], address, LIMIT, lambda spec, row: there.__setitem__(spec, plain(row)))
    pool.run_all([specs], 2, LIMIT, lambda spec, row: here.__setitem__(spec, plain(row)))
    assert [
        (k, v, here[s][k]) for s in specs for k, v in there[s].items() if v != here[s].get(k)
    ] == []
    assert there == here
    assert [there[s]["status"] for s in specs] == [
        "'ok'",
        "'timeout'",
        "'error'",
        "'crashed'",
        "'oom'",
        "'ok'",
    ]


@pytest.mark.long
@pytest.mark.survives("death")
def test_a_run_that_kills_its_workers_is_a_row_and_the_others_go_on(address, tmp_path):
    file = tmp_path / "bad.py"
    file.write_text(KILLER)
    specs = [
        Spec("tide", f"bad[how={how}]", "h", 0.01, "", (str(file),))
        for how in ("a", "b", "c", "kill", "d", "e")
    ]
    rows = {}
    far.run_all([specs], address, 60.0, lambda spec, row: rows.__setitem__(spec, row))
    assert [rows[s]["status"] for s in specs] == ["ok", "ok", "ok", "crashed", "ok", "ok"]
    assert "lost every worker" in rows[specs[3]]["why"]


@pytest.mark.long
def test_specifications_are_taken_as_they_are_needed_and_tasks_are_forgotten(address, monkeypatch):
    monkeypatch.setattr(far, "MAX_TASK_SIZE", 20)
    taken = [0]
    done = [0]
    most = [0]

    def specs():
        for _ in range(1000):
            taken[0] += 1
            yield Spec("sliding", "pbd", "h", float("nan"))

    def on_row(spec, row):
        done[0] += 1
        most[0] = max(most[0], taken[0] - done[0])

    far.run_all([specs()], address, 60.0, on_row)
    assert done[0] == 1000 and most[0] <= far.TASKS_PER_THREAD * 2 * 20
    with far.connect_client(address) as client:
        assert client.run_on_scheduler(lambda dask_scheduler: len(dask_scheduler.tasks)) <= 4
        assert not any(
            client.run(lambda: len(remote_worker._processes)).values()
        )  # and no process is left behind


@pytest.mark.long
def test_what_stops_a_study_stops_it_there_as_well(address, tmp_path):
    file = tmp_path / "bad.py"
    file.write_text(SOLVER)
    specs = [
        Spec("tide", "pbd", "h", 0.1),
        Spec("tide", "bad[how=hang]", "h", 0.01, "", (str(file),)),
    ] * 3

    def on_row(spec, row):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        far.run_all([specs], address, 600.0, on_row)
    with far.connect_client(address) as client:
        assert not any(client.run(lambda: len(remote_worker._processes)).values())
    rows = []
    far.run_all(
        [specs[:1]], address, 60.0, lambda spec, row: rows.append(row["status"])
    )  # nobody is still at work
    assert rows == ["ok"]


def test_a_task_that_comes_after_its_study_was_stopped_is_not_begun(tmp_path):
    file = tmp_path / "bad.py"
    file.write_text(SOLVER)
    hang, fine = (
        Spec("tide", f"bad[how={how}]", "h", 0.01, "", (str(file),)) for how in ("hang", "fine")
    )
    arguments = (
        remote_worker.Limits(600.0),
        "study",
        remote_worker.fingerprint(),
        [{str(file): SOLVER.encode()}],
    )
    rows = []
    thread = threading.Thread(
        target=lambda: rows.append(remote_worker.rows_of([hang, fine], *arguments))
    )
    thread.start()
    until = time.monotonic() + 60
    while (
        not any(process.pool.busy for process in [*remote_worker._processes.values()])
        and time.monotonic() < until
    ):
        time.sleep(0.05)
    (process,) = (
        worker.process for own in remote_worker._processes.values() for worker in own.pool.busy
    )
    remote_worker.dismiss("study")
    thread.join(30)
    assert (
        rows == [[]] and process.exitcode is not None
    )  # the run under way ends, its thread is free again
    assert remote_worker.rows_of([fine], *arguments) == [] and not remote_worker._processes
    others = remote_worker.rows_of([fine], arguments[0], "other study", *arguments[2:])
    assert [row["status"] for row, _ in others] == ["ok"]
    remote_worker.dismiss("other study")


def test_workers_unlike_this_installation_are_refused(address):
    here = remote_worker.fingerprint() | {"numpy": "1.0", "nsbench.cases": "0"}
    with far.connect_client(address) as client:
        with pytest.raises(
            far.ClusterError,
            match=r"tcp://.* nsbench.cases has other contents, numpy is .* \(here 1.0\)",
        ):
            far.check_workers(client, address, here)
        work = far._Work(
            client, address, iter([Spec("tide", "pbd", "h", 0.1)]), here, remote_worker.Limits(60.0)
        )
        with pytest.raises(
            far.ClusterError, match="that joined is not like this"
        ):  # after the others were looked at
            list(work.rows())
        with pytest.raises(far.ClusterError, match=r"cannot load nsbench: .* install the same"):
            far.check_workers(_Deaf(client), address, here)


class _Deaf:
    """A client one of whose workers cannot import what it is asked for."""

    def __init__(self, client):
        self.nthreads = client.nthreads

    def run(self, function, on_error):
        return {"tcp://there": ModuleNotFoundError("No module named 'nsbench'")}


def test_files_are_used_where_they_lie_or_as_copies_that_lie_alike(tmp_path, monkeypatch):
    file = tmp_path / "bad.py"
    data = tmp_path / "data" / "x.txt"
    file.write_text(SOLVER)
    unit = {str(file): SOLVER.encode(), str(data): b"1"}
    data.parent.mkdir()
    data.write_text("1")
    assert remote_worker._place_files([unit]) == {str(file): str(file), str(data): str(data)}
    data.write_text("2")
    places = [Path(p) for p in remote_worker._place_files([unit]).values()]
    assert [p.read_bytes() for p in places] == [*unit.values()] and places[
        1
    ].parent.parent == places[0].parent != tmp_path
    gone = str(tmp_path / "other" / "bad.py")
    (copy,) = remote_worker._with_local_paths(
        [Spec("tide", "bad[how=fine]", "h", 0.01, "", (gone,))],
        remote_worker._place_files([{gone: SOLVER.encode()}]),
    )
    assert copy.solver_files[0] != gone and run_one(copy)["status"] == "ok"
    with pytest.raises(
        remote_worker.OtherInstallation,
        match=r"x\.txt, too large to be sent, is not the same there",
    ):
        remote_worker._place_files([{str(file): SOLVER.encode(), str(data): "0" * 16}])


BEFORE = """
HOME = os.path.dirname(__file__)
sys.path.insert(0, HOME)
import beside, pluggy
with open(os.path.join(HOME, "ta" + "ble.txt")) as file:
    D = float(file.read())
"""


def study(file, out, address):
    return main(
        [
            "run",
            "tide",
            "--solvers",
            str(file),
            "-s",
            file.stem,
            "--h",
            "0.1,0.05",
            "-o",
            str(out),
            "--dask",
            address,
        ]
    )


@pytest.fixture
def plugin(tmp_path, monkeypatch):
    """A solver file with a module and data beside it."""
    monkeypatch.setattr(sys, "path", [*sys.path])
    (tmp_path / "beside.py").write_text("C = 1.0\n")
    (tmp_path / "table.txt").write_text("10.0")
    file = tmp_path / "mine.py"
    file.write_text(solver("pass", before=BEFORE, stats='{"mark": beside.C + D}'))
    yield file
    sys.modules.pop("beside", None)
    run_key.forget()


def sent(monkeypatch, tmp_path, change=lambda path, content: content):
    """As if the client's folder were one that workers do not have. change(path, content): what
    arrives there instead."""
    unit = far._Work._files_of
    asked = far._Work._with_parts
    away = lambda f: f.replace(str(tmp_path), "/not/there")
    monkeypatch.setattr(
        far._Work,
        "_files_of",
        lambda self, names: {away(f): change(f, c) for f, c in unit(self, names).items()},
    )
    monkeypatch.setattr(
        far._Work,
        "_with_parts",
        lambda self, spec: dataclasses.replace(
            asked(self, spec), solver_files=tuple(map(away, spec.solver_files))
        ),
    )


@pytest.mark.long
@pytest.mark.survives("stale")
def test_modules_and_data_beside_a_file_travel_with_it(address, plugin, tmp_path, monkeypatch):
    with monkeypatch.context() as m:
        sent(m, tmp_path)
        assert study(plugin, tmp_path / "r", address) == 0
    assert [r["mark"] for r in read_journal(tmp_path / "r").values()] == [11.0, 11.0]


@pytest.mark.long
@pytest.mark.survives("stale")
@pytest.mark.parametrize("name", ["beside.py", "table.txt"])
def test_a_row_of_other_files_than_the_client_has_is_refused(
    address, plugin, tmp_path, monkeypatch, capsys, name
):
    with monkeypatch.context() as m:
        sent(m, tmp_path, lambda path, content: content + b" " if path.endswith(name) else content)
        assert study(plugin, tmp_path / "r", address) == 5
    assert f" of something else: {name} has other contents" in capsys.readouterr().err
    assert not read_journal(tmp_path / "r")


@pytest.mark.long
@pytest.mark.survives("stale")
def test_a_worker_with_another_library_or_package_on_its_disk_is_refused(
    address, plugin, tmp_path, monkeypatch, capsys
):
    """Of a library that only a plugin needs, and of files that the worker has loaded long
    before."""
    version = run_key.version
    with monkeypatch.context() as m:
        m.setattr(run_key, "version", lambda name: "0.0" if name == "pluggy" else version(name))
        assert study(plugin, tmp_path / "r", address) == 5
    assert "pluggy is " in (said := capsys.readouterr().err) and "(here 0.0)" in said
    with monkeypatch.context() as m:
        m.setattr(run_key.package, "package_digest", run_key.functools.cache(lambda: "0" * 64))
        assert study(plugin, tmp_path / "r", address) == 5
    assert "nsbench has other contents" in capsys.readouterr().err
    assert not read_journal(tmp_path / "r")


@pytest.mark.long
@pytest.mark.survives("stale")
def test_a_file_that_changes_there_while_it_is_used_is_told(address, plugin, tmp_path, capsys):
    plugin.write_text(solver("os.utime(os.path.join(HOME, 'beside.py'))", before=BEFORE))
    assert study(plugin, tmp_path / "r", address) == 5
    assert "beside.py changed there while it was used" in capsys.readouterr().err
    assert not read_journal(tmp_path / "r")


@pytest.mark.long
def test_without_an_address_that_answers_it_is_said_soon(tmp_path, capsys, monkeypatch):
    run = ["run", "tide", "-s", "pbd", "-o", str(tmp_path / "r"), "--dask"]
    assert main([*run, "tcp://127.0.0.1:9"]) == 5
    assert "no scheduler answers at tcp://127.0.0.1:9" in capsys.readouterr().err
    assert main([*run, "nonsense"]) == 2 and "tcp://" in capsys.readouterr().err
    assert main([*run, "tcp://127.0.0.1:9", "-j", "2"]) == 2
    capsys.readouterr()
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert main([*run, "tcp://127.0.0.1:9"]) == 2
    assert "pip install 'nsbench[dask]'" in capsys.readouterr().err


@pytest.mark.long
def test_a_cluster_that_ends_is_told_and_what_it_gave_is_kept(tmp_path, capsys, monkeypatch):
    out = tmp_path / "r"
    first = Journal.append_all
    with cluster(1) as (where, process):

        def append(self, entries):
            first(self, entries)
            process.kill()

        monkeypatch.setattr(Journal, "append_all", append)
        assert main(["run", "tide", "-s", "pbd", "-o", str(out), "--dask", where]) == 5
    assert f"the scheduler at {where} is gone" in capsys.readouterr().err
    kept = read_journal(out)
    assert kept and all(r["shared"] for r in kept.values())
