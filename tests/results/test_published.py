"""Tables that are damaged, or older than the journal beside them, are neither kept nor judged."""

import os
import shutil
import signal
import subprocess
import sys
import time

import pytest
from runs_here import patch_runs, run_all

from nsbench.cli import main
from nsbench.execute import suite
from nsbench.gate import baseline
from nsbench.gate.facts import facts
from nsbench.report.data import read
from nsbench.results import consistency
from nsbench.results.atomic_write import StoreError, write_atomically
from nsbench.results.journal import Journal

pytestmark = pytest.mark.usefixtures("runs_here")
RUN = ["run", "tide", "-s", "pbd", "-s", "kdtree", "-j", "1"]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made") / "r"
    with pytest.MonkeyPatch.context() as m:
        patch_runs(m)
        assert main([*RUN, "--h", "0.05,0.025", "-o", str(folder)]) == 0
    lines = [baseline.line(fact, 0.0, "first") for fact in facts(read(folder)).values()]
    (folder / "b.csv").write_text(baseline.text(lines), encoding="utf-8")
    return folder


@pytest.fixture
def results(made, tmp_path):
    shutil.copytree(made, tmp_path / "r")
    return tmp_path / "r"


def judged(folder):
    return main(["gate", str(folder), "--baseline", str(folder / "b.csv")])


@pytest.mark.long
@pytest.mark.survives("spoilt results")
@pytest.mark.parametrize(
    "name", ["runs.parquet", "runs.csv", "cases.json", "solvers.json", "extra.json", "env.json"]
)
@pytest.mark.parametrize("data", [b"PAR1 broken", b"", None])
def test_a_damaged_file_is_named_and_the_same_command_mends_it(results, capsys, name, data):
    before = (results / name).read_bytes()
    (results / name).write_bytes(data) if data is not None else (results / name).unlink()
    for command in (
        ["gate", str(results), "--baseline", str(results / "b.csv")],
        ["report", str(results)],
        ["compare", str(results), str(results)],
    ):
        if name != "runs.parquet" or data is not None or command[0] != "report":
            capsys.readouterr()
            assert main(command) == 2 and name in capsys.readouterr().err
    assert main([*RUN, "--h", "0.05,0.025", "-o", str(results)]) == 0
    assert name == "env.json" or (results / name).read_bytes() == before
    assert judged(results) == 0


def test_nothing_is_written_again_when_nothing_changed(results):
    before = {p: p.stat().st_mtime_ns for p in results.rglob("*") if p.is_file()}
    assert main([*RUN, "--h", "0.05,0.025", "-o", str(results)]) == 0
    assert {
        p: p.stat().st_mtime_ns for p in results.rglob("*") if p.is_file()
    } == before and judged(results) == 0


@pytest.mark.survives("ctrl-c", "older tables")
@pytest.mark.parametrize("older", [False, True])
def test_a_report_of_an_interrupted_run_has_its_rows_and_says_what_is_missing(
    tmp_path, monkeypatch, capsys, older
):
    """Rows of the journal that the run did not plan, of an earlier study, are not among them."""
    out = tmp_path / "r"
    whole = ["run", "tide", "-s", "pbd", "-j", "1", "-o", str(out), "--h", "0.05,0.025,0.0125,0.01"]
    if older:
        assert main([*whole[:-1], "0.04,0.02"]) == 0

    def stops(batches, *args, **more):
        run_all([batches[0][:3]], *args, **more)
        raise KeyboardInterrupt

    with monkeypatch.context() as m:
        m.setattr(suite, "run_all", stops)
        assert main(whole) == 130
    capsys.readouterr()
    assert main(["report", str(out)]) == 0
    said = capsys.readouterr().out
    assert "1 of 4 planned runs are missing" in said and "the same command goes on" in said
    page = (out / "report.md").read_text()
    assert page.splitlines()[2].startswith("3 runs of 1 method on 1 case")
    assert "1 of 4 planned runs are missing" in page
    assert judged(out) == 2
    assert main(whole) == 0 and main(["report", str(out)]) == 0
    page = (out / "report.md").read_text()
    assert "planned runs" not in page and "4 runs of 1 method" in page
    assert "1 runs (3 known already)" in capsys.readouterr().out


def test_a_journal_without_a_plan_or_without_rows_is_reported_as_what_it_is(tmp_path, capsys):
    row = {"case": "tide", "solver": "pbd", "accuracy": "h", "asked": 0.1, "status": "ok"}
    Journal(tmp_path).close()
    assert main(["report", str(tmp_path)]) == 2 and "no results in" in capsys.readouterr().err
    for key, asked in (("a", 0.1), ("b", 0.1), ("c", 0.2)):
        writes = Journal(tmp_path)
        writes.append(key, row | {"asked": asked, "h": asked})
        writes.close()
    assert main(["report", str(tmp_path)]) == 0
    assert "an unknown number of planned runs" in capsys.readouterr().out
    assert "\n2 runs of 1 method on 1 case" in (tmp_path / "report.md").read_text()


@pytest.mark.long
@pytest.mark.survives("older tables")
@pytest.mark.parametrize("rows", [0, 1])
@pytest.mark.parametrize(
    "error, code",
    [(KeyboardInterrupt(), 130), (StoreError("no room"), 5), (ValueError("what"), 2)],
)
def test_tables_from_before_a_run_that_did_not_end_are_not_judged(
    results, monkeypatch, capsys, rows, error, code
):
    def stops(batches, jobs, timeout, on_row, *args, **more):
        for spec in batches[0][:rows]:
            on_row(spec, {"case": spec.case, "solver": spec.solver, "status": "ok"})
        raise error

    assert judged(results) == 0
    with monkeypatch.context() as m:
        m.setattr(suite, "run_all", stops)
        assert main([*RUN, "--h", "0.05,0.025,0.0125", "-o", str(results)]) == code
    capsys.readouterr()
    for command in (
        ["gate", str(results), "--baseline", str(results / "b.csv")],
        ["gate", str(results), "--baseline", str(results / "b.csv"), "--update", "--reason", "new"],
        ["compare", str(results), str(results)],
        ["calibrate", str(results)],
    ):
        assert main(command) == 2 and "run the same command again" in capsys.readouterr().err
    assert main([*RUN, "--h", "0.05,0.025,0.0125", "--force", "-o", str(results)]) == 0
    assert main(["report", str(results)]) == 0 and judged(results) in (
        1,
        4,
    )  # the ladder is another one


@pytest.mark.long
@pytest.mark.survives("older tables", "kill")
@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_tables_from_before_a_run_that_was_killed_are_not_judged(results):
    new = [sys.executable, "-m", "nsbench", *RUN, "--h", "1e-2..1e-4", "-o", str(results)]
    size = (results / "journal.jsonl").stat().st_size
    run = subprocess.Popen(new, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    end = time.monotonic() + 60
    while (results / "journal.jsonl").stat().st_size <= size and time.monotonic() < end:
        time.sleep(0.01)
    run.send_signal(signal.SIGKILL)
    run.wait()
    assert judged(results) == 2


def test_a_journal_that_has_grown_is_not_that_of_the_tables(results):
    journal = Journal(results)
    journal.append("k", {"x": 1.0})
    journal.close()
    assert judged(results) == 2


def test_copies_of_tables_and_folders_of_older_versions_are_read(results):
    (results / ".report.key").write_text("0" * 64)
    assert judged(results) == 0
    (results / ".report.key").unlink()
    assert judged(results) == 0
    (results / "journal.jsonl").unlink()
    assert judged(results) == 0


def test_a_table_that_is_not_as_it_was_written_a_moment_ago_ends_with_5(
    results, monkeypatch, capsys
):
    whole = write_atomically

    def bad(path, data):
        whole(path, data[:-1] if path.name == "runs.csv" else data)

    with monkeypatch.context() as m:
        m.setattr("nsbench.results.tables.write_atomically", bad)
        assert main([*RUN, "--h", "0.05,0.025", "--force", "-o", str(results)]) == 5
    assert "runs.csv is not what was written" in capsys.readouterr().err and judged(results) == 2


@pytest.mark.survives("closed list")
def test_a_run_without_a_row_is_told(tmp_path, monkeypatch, capsys):
    out = tmp_path / "r"
    plain = suite.run_all

    def loses(batches, jobs, timeout, on_row, *args, **more):
        return plain(
            batches,
            jobs,
            timeout,
            lambda s, row: s.solver == "kdtree" or on_row(s, row),
            *args,
            **more,
        )

    with monkeypatch.context() as m:
        m.setattr(suite, "run_all", loses)
        assert main([*RUN, "--h", "0.05", "-o", str(out)]) == 3
    assert (
        "No worker gave a row" in (out / "runs.csv").read_text()
        and "1 of 2 runs failed" in capsys.readouterr().out
    )
    assert main([*RUN, "--h", "0.05", "-o", str(out)]) == 0


def test_the_key_tells_of_every_file_that_a_gate_reads(results):
    told = consistency._key_lines(results)
    assert len(told) == 2 + len(consistency.FILES) and len(told[0]) == 64
