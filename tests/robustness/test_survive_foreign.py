"""Results that somebody else made: what is no regular file below their folder is neither waited for
nor embedded, what expands to more than memory is not expanded, and numbers are checked on entry."""

import contextlib
import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from report_rows import row

import nsbench
from nsbench import reference
from nsbench.cli import main
from nsbench.gate import baseline, spreads
from nsbench.gate.facts import facts
from nsbench.report import stored_results
from nsbench.report.data import read
from nsbench.results import consistency
from nsbench.results import tables as store
from nsbench.results.journal import SCHEMA, read_journal

SECONDS = 60.0  # within which a command that waits for a writer is given up
SVG = '<svg viewBox="0 0 1 1"><text>{}</text></svg>'
FILES = (
    "runs.parquet",
    "runs.csv",
    "journal.jsonl",
    ".report.key",
    "cases.json",
    "solvers.json",
    "env.json",
    "extra.json",
    "figures/scene_tide.svg",
)
no_fifo = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no FIFOs here")


@pytest.fixture
def folder(tmp_path):
    """Whole results of three runs."""
    out = tmp_path / "r"
    (out / "figures").mkdir(parents=True)
    (out / "figures" / "scene_tide.svg").write_text(SVG.format("inside"))
    (out / "journal.jsonl").write_text("")
    rows = [row("tide", "pbd", h, state_sup=h) for h in (0.1, 0.05, 0.02)]
    tables = store.write_tables(out, rows)
    for name in ("cases", "solvers", "extra"):
        (out / f"{name}.json").write_text("{}")
    (out / "env.json").write_text(json.dumps({"schema": SCHEMA}))
    consistency.mark_consistent(out, "rows", tables)
    assert main(["report", str(out)]) == 0
    for page in out.glob("report.*"):
        page.unlink()
    return out


def to_fifo(path, elsewhere):
    os.mkfifo(path)


def to_device(path, elsewhere):
    path.symlink_to("/dev/zero")


def to_outside(path, elsewhere):
    path.symlink_to(elsewhere)


def to_nowhere(path, elsewhere):
    path.symlink_to("nowhere")


def to_folder(path, elsewhere):
    path.mkdir()


def spoil(folder, name, damage):
    """Put something else in the place of a file of results; runs.csv counts alone."""
    path = folder / name
    elsewhere = folder.parent / "elsewhere"
    elsewhere.write_bytes(path.read_bytes())
    if name == "runs.csv":
        (folder / "runs.parquet").unlink()
        (folder / ".report.key").unlink()
    path.unlink()
    damage(path, elsewhere)
    return path


@pytest.mark.long
@no_fifo
@pytest.mark.survives("no plain file")
@pytest.mark.parametrize("damage", [to_fifo, to_device, to_outside, to_nowhere, to_folder])
@pytest.mark.parametrize("name", [n for n in FILES if n != "journal.jsonl"])
def test_what_is_no_file_of_its_own_is_refused_by_name(folder, name, damage):
    """In a process that is given up if it waits."""
    path = spoil(folder, name, damage)
    code = (
        "import sys\nfrom nsbench.report.data import read\n"
        "from nsbench.results.consistency import check\n"
        "try:\n    check(sys.argv[1]); read(sys.argv[1])\n"
        "except ValueError as e:\n    print(e)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(folder)],
        capture_output=True,
        text=True,
        timeout=SECONDS,
    )
    assert str(path) in done.stdout, done
    assert not done.stderr


@pytest.mark.long
@no_fifo
@pytest.mark.survives("no plain file")
@pytest.mark.parametrize("damage", [to_fifo, to_device, to_outside, to_nowhere, to_folder])
def test_a_journal_that_is_no_file_of_its_own_is_refused_by_name(folder, damage):
    path = spoil(folder, "journal.jsonl", damage)
    with pytest.raises(ValueError, match="journal") as raised:
        read_journal(folder)
    assert str(path) in str(raised.value)


@pytest.mark.survives("no plain file")
def test_nothing_outside_of_the_folder_is_embedded(folder, capsys):
    """By a link to a file, and by one to a folder."""
    private = folder.parent / "private"
    private.mkdir()
    (private / "scene_tide.svg").write_text(SVG.format("outside"))
    scene = folder / "figures" / "scene_tide.svg"
    scene.unlink()
    scene.symlink_to(private / "scene_tide.svg")
    assert main(["report", str(folder)]) == 2
    assert str(scene) in capsys.readouterr().err
    scene.unlink()
    for made in (folder / "figures").iterdir():
        made.unlink()
    (folder / "figures").rmdir()
    (folder / "figures").symlink_to(private)
    assert main(["report", str(folder)]) == 2
    assert str(scene) in capsys.readouterr().err and not (folder / "report.html").exists()


def test_a_link_within_the_folder_is_followed(folder):
    scene = folder / "figures" / "scene_tide.svg"
    scene.rename(folder / "tide.svg")
    scene.symlink_to("../tide.svg")
    assert "inside" in read(folder).pictures["tide"]
    (folder.parent / "link").symlink_to(folder)
    assert "inside" in read(folder.parent / "link").pictures["tide"]


@pytest.mark.survives("no plain file")
def test_a_run_does_not_empty_a_file_to_which_the_key_file_is_a_link(folder):
    other = folder.parent / "other"
    other.write_text("precious")
    (folder / ".report.key").unlink()
    (folder / ".report.key").symlink_to(other)
    with pytest.raises(consistency.StoreError, match=r"\.report\.key"):
        consistency.mark_stale(folder)
    assert other.read_text() == "precious"


@pytest.mark.parametrize("left", [".report.key", "runs.csv", "runs.parquet"])
def test_one_file_of_tables_is_enough_for_a_run_to_call_them_stale(folder, left):
    for name in {".report.key", "runs.csv", "runs.parquet"} - {left}:
        (folder / name).unlink()
    consistency.mark_stale(folder)
    assert (folder / ".report.key").read_bytes() == b""


@pytest.mark.survives("oversized")
@pytest.mark.parametrize(
    "name, mebibytes, read_it",
    [
        ("calibration.csv", 10, spreads.read),
        ("baseline.csv", 10, lambda folder: baseline.read(folder / "baseline.csv")),
        (".report.key", 1, consistency.check),
        ("runs.csv", 2048, consistency.check),
        ("journal.jsonl", 16384, read_journal),
    ],
)
def test_a_file_one_byte_too_long_is_refused_by_its_size(folder, name, mebibytes, read_it):
    """It has a hole, and takes no space."""
    with open(folder / name, "ab") as file:
        file.truncate((mebibytes << 20) + 1)
    with pytest.raises(ValueError, match=f"at most {mebibytes << 20} are read"):
        read_it(folder)


@pytest.mark.survives("oversized")
@pytest.mark.parametrize("more", [0, 1])
def test_a_line_one_byte_longer_than_any_of_a_journal_is_refused(folder, more):
    """One that is as long as may be is damaged as others are."""
    (folder / "journal.jsonl").write_bytes(b"x" * ((16 << 20) + more) + b"\n")
    refused = pytest.raises(ValueError, match=f"longer than {16 << 20} bytes")
    damaged = []
    with refused if more else contextlib.nullcontext():
        read_journal(folder, damaged)
    assert damaged == [1] * (not more)


@no_fifo
@pytest.mark.survives("no plain file")
def test_a_key_file_names_files_of_results_alone(folder):
    with open(folder / ".report.key", "a", encoding="utf-8") as file:
        file.write("\n../../../etc/hostname 0")
    with pytest.raises(ValueError, match="hostname"):
        consistency.check(folder)


@pytest.mark.survives("oversized")
def test_a_table_that_expands_to_more_than_is_read_is_refused(folder, monkeypatch):
    """By its metadata: rows of one value, or one long word for all rows, take no space on disk."""
    path = folder / "runs.parquet"
    reads = []
    monkeypatch.setattr(pq.ParquetFile, "read", lambda self: reads.append(1))
    schema = pa.schema([("case", pa.string()), ("solver", pa.string()), ("status", pa.string())])
    block = pa.table({n: ["x"] * 1_000_000 for n in schema.names}, schema=schema)
    with pq.ParquetWriter(path, schema) as writer:
        for _ in range(3):
            writer.write_table(block)
    assert path.stat().st_size < 1 << 20
    with pytest.raises(ValueError, match=r"runs\.parquet holds 3000000 rows"):
        read(folder)
    pq.write_table(pa.table({n: ["x" * 50_000] * 20 for n in schema.names}), path)
    monkeypatch.setattr(stored_results, "MAX_TABLE_BYTES", 100_000)
    assert path.stat().st_size < 100_000
    with pytest.raises(ValueError, match=r"runs\.parquet unpacks to \d+ bytes"):
        read(folder)
    assert not reads


@pytest.mark.survives("oversized")
def test_a_word_of_many_rows_is_stored_once(folder):
    words = {"case": "tide", "solver": "pbd", "status": "error", "why": "w" * 1000}
    table = pa.table({n: pa.array([w] * 500) for n, w in words.items()})
    pq.write_table(table, folder / "runs.parquet")
    values = stored_results.read_table(folder)[1]["why"]
    assert len(values) == 500 and len({id(v) for v in values}) == 1


@pytest.mark.survives("oversized")
def test_rows_of_a_text_table_are_counted(folder, monkeypatch):
    (folder / "runs.parquet").unlink()
    monkeypatch.setattr(stored_results, "MAX_CELLS", 1000)
    (folder / "runs.csv").write_text("case,solver,status\n" + ",,\n" * 1000)
    with pytest.raises(ValueError, match=r"runs\.csv holds"):
        read(folder)


@pytest.mark.survives("spoilt results")
def test_columns_of_other_types_are_refused(folder):
    table = pq.read_table(folder / "runs.parquet")
    for values in ([[1.0]] * 3, [b"x"] * 3, [{"a": 1}] * 3):
        pq.write_table(table.append_column("more", pa.array(values)), folder / "runs.parquet")
        with pytest.raises(ValueError, match=r"runs\.parquet: more is of type"):
            read(folder)


@pytest.mark.parametrize("kind", [pa.large_string(), pa.dictionary(pa.int32(), pa.string())])
def test_tables_of_other_writers_are_read_as_before(tmp_path, kind):
    words = {"case": ["tide", None], "solver": ["pbd"] * 2, "status": ["ok"] * 2}
    numbers = {"h": pa.array([1, 2], pa.int32()), "multipliers_unique": pa.array([True, None])}
    table = pa.table({n: pa.array(w).cast(kind) for n, w in words.items()} | numbers)
    pq.write_table(table, tmp_path / "runs.parquet")
    found = read(tmp_path).runs
    assert [*found] == [("(unnamed)", "pbd"), ("tide", "pbd")]
    assert found["tide", "pbd"].col["h"][0] == 1.0
    assert found["tide", "pbd"].col["multipliers_unique"][0] == 1.0
    assert np.isnan(found["(unnamed)", "pbd"].col["multipliers_unique"][0])


@pytest.mark.survives("spoilt results")
@pytest.mark.parametrize("value", [np.inf, -np.inf])
@pytest.mark.parametrize("name", ["events_missed", "steps", "multipliers_unique"])
@pytest.mark.parametrize("table", ["runs.parquet", "runs.csv"])
def test_a_count_that_is_infinite_is_refused_by_name(folder, capsys, table, name, value):
    rows = [row("tide", "pbd", h, state_sup=h) | {name: value} for h in (0.1, 0.05, 0.02)]
    store.write_tables(folder, rows)
    (folder / ".report.key").unlink()
    if table == "runs.csv":
        (folder / "runs.parquet").unlink()
    with pytest.raises(ValueError, match=f"{name} of pbd on tide") as raised:
        read(folder)
    assert str(folder / table) in str(raised.value)


BIG = 10**400


@pytest.mark.survives("spoilt results")
@pytest.mark.parametrize(
    "name, text",
    [
        ("cases.json", json.dumps({"tide": {"T": BIG}})),
        ("cases.json", json.dumps({"tide": {"n": BIG}})),
        ("cases.json", json.dumps({"tide": {"n": "x"}})),
        ("cases.json", '{"tide": {"T": 1e999}}'),
        ("cases.json", '{"tide": {"T": NaN}}'),
        ("cases.json", json.dumps({"tide": {"classes": [[1]]}})),
        ("cases.json", json.dumps({"tide": {"certificate": {"state": "x"}}})),
        ("solvers.json", json.dumps({"pbd": {"claims": {"state": "x"}}})),
        ("solvers.json", json.dumps({"pbd": {"claims": {"rounding": BIG}}})),
        ("solvers.json", '{"pbd": {"claims": {"exact": -Infinity}}}'),
        ("solvers.json", json.dumps({"pbd": {"expects": [{"when": []}]}})),
        ("env.json", json.dumps({"cores": BIG})),
        ("extra.json", json.dumps({"talk_figure": {"runs": 1.0}})),
        ("extra.json", json.dumps({"talk_figure": {"runs": [{"dt": BIG, "x": [[0, 0]]}]}})),
    ],
)
def test_a_number_of_the_notes_that_is_none_is_refused_by_name(folder, capsys, name, text):
    (folder / ".report.key").unlink()
    (folder / name).write_text(text)
    for args in (["report", folder], ["gate", folder, "--baseline", "b.csv"]):
        assert main([str(a) for a in args]) == 2
        assert str(folder / name) in capsys.readouterr().err


def test_a_length_that_is_not_known_is_that_of_a_case_without_notes(folder):
    (folder / "cases.json").write_text(json.dumps({"tide": {"T": None}}))
    without = facts(read(folder))
    (folder / "cases.json").write_text("{}")
    assert facts(read(folder)).keys() == without.keys()


@pytest.mark.survives("spoilt results")
def test_a_number_of_a_journal_that_no_row_holds_is_a_damaged_line(tmp_path):
    entry = {"schema": SCHEMA, "key": "a", "parts": [], "row": {"steps": BIG}}
    (tmp_path / "journal.jsonl").write_text(json.dumps(entry) + "\n")
    damaged = []
    assert read_journal(tmp_path, damaged) == {} and damaged == [1]


@no_fifo
@pytest.mark.survives("no plain file")
@pytest.mark.parametrize("damage", [to_fifo, to_device, to_nowhere, to_folder])
def test_a_baseline_or_calibration_that_is_no_file_is_named(folder, damage):
    for path, load in (
        (folder.parent / "b.csv", lambda: baseline.read(folder.parent / "b.csv")),
        (folder / spreads.NAME, lambda: spreads.read(folder)),
    ):
        damage(path, None)
        with pytest.raises(ValueError, match="csv") as raised:
            load()
        assert str(path) in str(raised.value)


@no_fifo
@pytest.mark.survives("no plain file", "spoilt reference")
@pytest.mark.parametrize("damage", [to_fifo, to_device, to_nowhere, to_folder])
@pytest.mark.parametrize("part", [0, 1])
def test_a_reference_that_is_no_file_is_named(tmp_path, damage, part):
    case = nsbench.get_case("three_discs")
    paths = reference.files_of(case, tmp_path)
    for source, path in zip(reference.files_of(case), paths, strict=True):
        shutil.copy(source, path)
    paths[part].unlink()
    damage(paths[part], None)
    with pytest.raises(reference.BadReference) as raised:
        reference.load(case, tmp_path)
    assert str(paths[part]) in str(raised.value)


@pytest.mark.survives("spoilt results")
@pytest.mark.parametrize("h", [1e308, 1e160, 5e-324])
def test_a_step_of_any_size_has_a_report(tmp_path, h):
    rows = [row("tide", "pbd", k, state_sup=k) for k in np.geomspace(0.1, 1e-3, 12)]
    rows[5] |= {"h": h, "asked": h}
    store.write_tables(tmp_path, rows)
    assert main(["report", str(tmp_path)]) == 0
