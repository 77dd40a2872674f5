"""Nothing finished is lost, half a line is dropped, and a changed input is never served from the
journal."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pyarrow.parquet
import pytest
from solver_file import solver

from nsbench import columns
from nsbench.cli import main
from nsbench.results import consistency, tables
from nsbench.results.atomic_write import StoreError, write_atomically
from nsbench.results.environment import environment, start_of_runs
from nsbench.results.journal import (
    SCHEMA,
    Journal,
    as_read,
    clean,
    read_journal,
    read_parts,
    read_plan,
)


def test_rows_come_back_as_they_were_written(tmp_path):
    row = {
        "case": "tide",
        "state_sup": 0.1 + 0.2,
        "impulse": np.float64("nan"),
        "l1": float("inf"),
        "steps": np.int64(3),
        "why": 'a, "b"\n=cmd()',
        "flag": True,
    }
    j = Journal(tmp_path)
    j.append("k", row)
    j.close()
    back = read_journal(tmp_path)["k"]
    assert back["state_sup"] == 0.1 + 0.2 and np.isnan(back["impulse"]) and back["l1"] == np.inf
    assert back["why"] == row["why"] and back["flag"] is True and back["steps"] == 3


@pytest.mark.survives("half a line")
def test_half_a_line_is_dropped_and_mended(tmp_path):
    j = Journal(tmp_path)
    j.append("a", {"x": 1.0})
    j.append("b", {"x": 2.0})
    j.close()
    path = tmp_path / "journal.jsonl"
    path.write_bytes(path.read_bytes()[:-7])
    assert list(read_journal(tmp_path)) == ["a"]
    j = Journal(tmp_path)
    j.append("c", {"x": 3.0})
    j.close()
    assert list(read_journal(tmp_path)) == ["a", "c"]
    path.write_bytes(b"garbage\n\x00\xff\n" + path.read_bytes())
    assert list(read_journal(tmp_path)) == ["a", "c"]


@pytest.mark.survives("one folder")
def test_two_runs_in_one_folder_are_refused(tmp_path):
    j = Journal(tmp_path)
    with pytest.raises(StoreError, match="another run"):
        Journal(tmp_path)
    j.close()
    Journal(tmp_path).close()


@pytest.mark.survives("one folder")
def test_a_second_suite_in_the_folder_of_one_that_goes_on_is_refused_and_changes_nothing(
    tmp_path, capsys
):
    file = tmp_path / "slow.py"
    out = tmp_path / "r"
    file.write_text(solver("ctypes.PyDLL(None).sleep(1000 if h < 0.05 else 0)"))
    args = [
        "run",
        "tide",
        "--solvers",
        str(file),
        "-s",
        "slow",
        "--h",
        "0.1,0.01",
        "-j",
        "1",
        "-o",
        str(out),
    ]
    first = subprocess.Popen(
        [sys.executable, "-m", "nsbench", *args], stdout=subprocess.DEVNULL, start_new_session=True
    )
    try:
        until = time.monotonic() + 60
        while (
            not ((out / "journal.jsonl").exists() and read_journal(out))
            and time.monotonic() < until
        ):
            time.sleep(0.05)
        before = (out / "journal.jsonl").read_bytes()
        assert len(read_journal(out)) == 1 and first.poll() is None
        assert main(["run", "tide", "-s", "pbd", "--h", "0.1", "-o", str(out)]) == 5
        assert "another run is writing" in capsys.readouterr().err
        assert (out / "journal.jsonl").read_bytes() == before and not (out / "report.html").exists()
        assert first.poll() is None
    finally:
        os.killpg(first.pid, signal.SIGINT)
        assert first.wait(30) == 130


def test_what_a_run_was_made_of_is_told_once_and_comes_back(tmp_path):
    from nsbench.results.run_key import Part

    old = Part.of({"a.py": "1"})
    new = Part.of({"a.py": "2"})
    row = {"case": "tide", "solver": "pbd", "accuracy": "h", "asked": 0.1}
    j = Journal(tmp_path)
    for part in (old, old, new):
        j.append("k", row, (part,))
    j.append("l", row | {"asked": float("nan")})
    j.close()
    made, parts = read_parts(tmp_path)
    assert made == {("tide", "pbd", "h", "0.1"): [new.digest], ("tide", "pbd", "h", "nan"): []}
    assert parts == {old.digest: {"a.py": "1"}, new.digest: {"a.py": "2"}}
    assert len((tmp_path / "journal.jsonl").read_text().splitlines()) == 6
    assert [*read_journal(tmp_path)] == ["k", "l"]


def test_the_last_plan_counts_whatever_the_number_of_its_lines(tmp_path, monkeypatch):
    monkeypatch.setattr("nsbench.results.journal.PLANNED", 2)
    assert read_plan(tmp_path) == []
    for plan in (list("abcdefg"), list("xyz")):
        j = Journal(tmp_path)
        j.append_plan(plan)
        j.append("a", {"x": 1.0})
        j.close()
        assert read_plan(tmp_path) == plan
    damaged = []
    assert list(read_journal(tmp_path, damaged)) == ["a"] and not damaged
    assert read_parts(tmp_path)[1] == {}


def test_tables_keep_every_column_and_row(tmp_path):
    import pandas

    rows = [
        {"case": "a", "x": 1.0, "why": ""},
        {"case": "b", "why": "=1+1", "n": 3},
        {"case": "c", "x": float("nan")},
    ]
    tables.write_tables(tmp_path, rows)
    for frame in (
        pandas.read_parquet(tmp_path / "runs.parquet"),
        pandas.read_csv(tmp_path / "runs.csv"),
    ):
        assert list(frame.columns) == ["case", "x", "why", "n"] and len(frame) == 3
        assert frame.x[0] == 1.0 and np.isnan(frame.x[2])


def test_reading_a_table_leaves_no_thread_behind(tmp_path):
    """A thread of the reader that frees its buffer while Python ends aborts the process."""
    tables.write_tables(tmp_path, [{"case": "tide", "state_sup": 0.1 * k} for k in range(100)])
    code = (
        "import sys, psutil, pathlib\n"
        "import numpy, pyarrow.parquet\n"
        "from nsbench.report.stored_results import read_table\n"
        "before = psutil.Process().num_threads()\n"
        "read_table(pathlib.Path(sys.argv[1]))\n"
        "print(psutil.Process().num_threads() - before)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, timeout=120
    )
    assert done.stdout == "0\n", done.stderr


def test_every_column_carries_unit_meaning_and_owner(tmp_path):
    import pyarrow.parquet

    from nsbench.measure import clock

    row = (
        clock.columns([0.1, 0.2, 0.4])
        | clock.prepared(lambda: None)[1]
        | {"session": "a", "h": 0.1, "state_sup": 1e-3, "own_count": 3}
    )
    tables.write_tables(tmp_path, [row])
    schema = pyarrow.parquet.read_schema(tmp_path / "runs.parquet")
    for field in schema:
        column = columns.describe(field.name)
        assert field.metadata[b"unit"] == column.unit.encode()
        assert field.metadata[b"meaning"] == column.meaning.encode() != b""
        assert field.metadata[b"owner"] == column.owner.encode()
    units = {f.name: f.metadata[b"unit"] for f in schema}
    assert (units["seconds"], units["rounds"], units["state_sup"]) == (b"s", b"1", b"state")
    assert schema.field("own_count").metadata[b"owner"] == b"solver" and units["own_count"] == b""
    assert schema.metadata[b"nsbench_schema"] == b"1"


def test_no_half_file_is_left(tmp_path):
    with pytest.raises(StoreError):
        write_atomically(tmp_path / "missing" / "f", b"x")
    write_atomically(tmp_path / "f", b"one")
    write_atomically(tmp_path / "f", b"two")
    assert (tmp_path / "f").read_bytes() == b"two" and len(list(tmp_path.iterdir())) == 1


def test_environment_is_plain_json():
    env = json.loads(json.dumps(environment(**start_of_runs())))
    assert env["versions"]["numpy"] == np.__version__
    assert env["began"] <= env["written"] and len(env["load_at_start"]) == len(env["load"])
    assert isinstance(env["processor"], str)


HALF = "no file t\udcff.csv"


@pytest.mark.survives("half a character")
def test_text_that_utf8_cannot_spell_is_told_by_its_numbers(tmp_path):
    """In new rows, in those of a journal that was written before, and in tables."""
    assert clean({"why": HALF, HALF: 1.0}) == {
        "why": r"no file t\udcff.csv",
        r"no file t\udcff.csv": 1.0,
    }
    j = Journal(tmp_path)
    j.append("new", {"why": HALF, HALF: 1.0})
    j.close()
    path = tmp_path / "journal.jsonl"
    path.write_text(
        path.read_text()
        + json.dumps({"schema": 1, "key": "old", "row": {"why": HALF, "n": 2}})
        + "\n"
    )
    rows = [*read_journal(tmp_path).values(), {"why": HALF, HALF: "\udc00"}]
    assert rows[0] == {"why": r"no file t\udcff.csv", r"no file t\udcff.csv": 1.0}
    assert rows[1]["why"] == r"no file t\udcff.csv"
    tables.write_tables(tmp_path, rows)
    import pandas

    for frame in (
        pandas.read_parquet(tmp_path / "runs.parquet"),
        pandas.read_csv(tmp_path / "runs.csv"),
    ):
        assert (
            set(frame.why) == {r"no file t\udcff.csv"} and r"no file t\udcff.csv" in frame.columns
        )


def test_whole_numbers_beyond_64_bits_are_numbers_like_others(tmp_path):
    row = {"a": 2**63 - 1, "b": -(2**70), "c": 10**400, "d": -(10**5000)}
    j = Journal(tmp_path)
    j.append("k", row)
    j.close()
    back = read_journal(tmp_path)["k"]
    assert back == as_read(row) == {"a": 2**63 - 1, "b": -(2.0**70), "c": np.inf, "d": -np.inf}
    tables.write_tables(tmp_path, [back])


@pytest.mark.survives("half a character")
def test_a_run_that_raises_such_text_leaves_tables_and_a_report(tmp_path, capsys):
    from solver_file import solver

    from nsbench.cli import main

    (tmp_path / "mine.py").write_text(
        solver('raise ValueError("no file " + os.fsdecode(b"t\\xff.csv"))')
    )
    args = [
        "run",
        "tide",
        "--solvers",
        str(tmp_path / "mine.py"),
        "-s",
        "mine",
        "-s",
        "kdtree",
        "--h",
        "0.1",
        "-j",
        "1",
        "-o",
        str(tmp_path / "r"),
    ]
    assert [main(args), main(args)] == [3, 3]
    assert r"no file t\udcff.csv" in (tmp_path / "r" / "runs.csv").read_text(encoding="utf-8")
    assert "udcff" in (tmp_path / "r" / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "stats, status",
    [({"n": 10**400, "t": "x" * 10**6}, "ok"), ({f"s{k}": k for k in range(300)}, "error")],
)
def test_what_a_solver_counts_has_a_sane_size(tmp_path, stats, status):
    from solver_file import solver

    from nsbench.study import Spec
    from nsbench.study.attempt import attempt

    (tmp_path / "mine.py").write_text(solver("pass", stats=repr(stats)))
    row = attempt(Spec("tide", "mine", "h", 0.1, "", (str(tmp_path / "mine.py"),)))[0]
    assert row["status"] == status, row["why"]
    assert len(json.dumps(clean(row))) < 30_000


def test_the_middle_of_a_long_sentence_is_left_out():
    from nsbench.study.attempt import LONGEST, _status
    from nsbench.trajectory import Status

    for size in (1, LONGEST // 2, LONGEST // 2 + 1, LONGEST, LONGEST + 1, 10**7):
        why = _status(Status("error", "a" + "b" * (size - 2) + "c" * (size > 1)))["why"]
        assert (
            len(why) == (size if size <= LONGEST else LONGEST + 5)
            and why[0] == "a"
            and (" ... " in why) == (size > LONGEST)
        )
        assert size == 1 or why[-1] == "c"


def test_a_missing_value_decides_no_type(tmp_path):
    rows = [{"a": None, "b": None, "c": None}, {"a": 1.5, "b": "text", "c": True}]
    tables.write_tables(tmp_path, rows)
    schema = pyarrow.parquet.read_schema(tmp_path / "runs.parquet")
    assert [str(f.type) for f in schema] == ["double", "string", "bool"]


def test_that_files_are_out_of_date_is_on_the_disk_before_what_follows(tmp_path, monkeypatch):
    synced = []
    real = os.fsync
    monkeypatch.setattr(os, "fsync", lambda number: synced.append(real(number)))
    (tmp_path / "runs.csv").touch()
    consistency.mark_stale(tmp_path)
    assert len(synced) == 1


@pytest.mark.parametrize("name", consistency.FILES)
def test_only_a_folder_with_tables_has_files_that_are_out_of_date(tmp_path, name):
    (tmp_path / name).touch()
    consistency.mark_stale(tmp_path)
    assert (tmp_path / consistency.KEY_FILE).exists() == name.startswith("runs.")


def test_lines_of_another_schema_and_parts_are_no_rows(tmp_path):
    lines = [
        {"schema": SCHEMA, "key": "a", "row": {"x": 1.0}},
        {"schema": SCHEMA + 1, "key": "b", "row": {"x": 1.0}},
        {"schema": SCHEMA, "part": "p", "key": "c", "row": {"x": 1.0}},
    ]
    (tmp_path / "journal.jsonl").write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    assert list(read_journal(tmp_path)) == ["a"]


def test_the_last_line_counts_without_its_end_too(tmp_path):
    lines = [json.dumps({"schema": SCHEMA, "key": key, "row": {"x": 1.0}}) for key in "ab"]
    (tmp_path / "journal.jsonl").write_text("\n".join(lines))
    assert list(read_journal(tmp_path)) == ["a", "b"]


@pytest.mark.parametrize(
    "value, text", [("'=1", "=1"), ("'plain", "'plain"), ("=1", "=1"), ("'", "'"), (3, 3)]
)
def test_only_the_apostrophe_before_a_formula_is_taken_away(value, text):
    assert tables.text_of(value) == text
