"""Files that are damaged, foreign, far too large or no data at all are an error that names them,
and nothing in them runs."""

import csv
import io
import json
import os
import pickle
import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from report_rows import made, row
from survive_files import case_file

import nsbench
from nsbench import reference
from nsbench.cli import main
from nsbench.report import write_report
from nsbench.report.data import read
from nsbench.results import tables as store
from nsbench.results.journal import SCHEMA, Journal, read_journal

ROOT = Path(nsbench.__file__).parent


class Harm:
    """What unpickling would do: make the file `path`."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


def results(folder):
    folder.mkdir()
    store.write_tables(folder, [r for r in made() if r["case"] == "tide"])
    for name in ("cases", "solvers", "extra"):
        (folder / f"{name}.json").write_text("{}")
    (folder / "env.json").write_text(json.dumps({"schema": SCHEMA}))
    return folder


def named(args, path, capsys):
    """Exit code 2, with the file's name in the message."""
    assert main([str(a) for a in args]) == 2
    said = capsys.readouterr().err
    assert str(path) in said, said
    return said


@pytest.mark.survives("spoilt results")
@pytest.mark.parametrize("keep", [0, 1, 4, 0.3, 0.9, -8, -1])
def test_a_table_that_is_cut_short_is_named_by_every_command(tmp_path, capsys, keep):
    folder = results(tmp_path / "r")
    path = folder / "runs.parquet"
    data = (folder / "runs.parquet").read_bytes()
    path.write_bytes(data[: int(keep * len(data)) if isinstance(keep, float) else keep])
    base = tmp_path / "b.csv"
    base.write_text("case\n")
    for args in (
        ["report", folder],
        ["gate", folder, "--baseline", base],
        ["compare", folder, folder],
        ["compare", folder, "x"],
    ):
        named(args, path, capsys)
    assert not (folder / "report.html").exists()


@pytest.mark.survives("spoilt results")
def test_a_damaged_byte_of_a_table_is_an_error_or_changes_nothing(tmp_path):
    """Every page has a checksum. Names, types and statistics at the end of the file have none;
    errors of numbers are in pages."""
    folder = results(tmp_path / "r")
    path = folder / "runs.parquet"
    data = (folder / "runs.parquet").read_bytes()
    good = read(folder)
    body = len(data) - 8 - int.from_bytes(data[-8:-4], "little")
    rng = np.random.default_rng(0)
    noticed = 0
    for place in rng.choice(body, 60, replace=False):
        path.write_bytes(
            data[:place] + bytes([data[place] ^ (1 << int(rng.integers(8)))]) + data[place + 1 :]
        )
        try:
            found = read(folder)
        except ValueError as e:
            assert "runs.parquet" in str(e)
            noticed += 1
            continue
        for key, runs in good.runs.items():
            for name, values in runs.col.items():
                np.testing.assert_array_equal(found.runs[key].col[name], values)
    assert noticed >= 50


@pytest.mark.survives("spoilt results")
@pytest.mark.parametrize(
    "name, text",
    [
        ("cases.json", "{"),
        ("solvers.json", "[1]"),
        ("env.json", '"x"'),
        ("extra.json", "\x00"),
        ("cases.json", "[" * 100_000),
    ],
)
def test_notes_that_cannot_be_read_are_named(tmp_path, capsys, name, text):
    folder = results(tmp_path / "r")
    (folder / name).write_text(text)
    named(["report", folder], folder / name, capsys)


@pytest.mark.survives("spoilt results")
@pytest.mark.parametrize(
    "name, entry, field, value",
    [
        ("cases.json", "tide", "classes", 5),
        ("cases.json", "tide", "T", "x"),
        ("cases.json", "tide", "T", [1]),
        ("solvers.json", "pbd", "claims", [1]),
        ("solvers.json", "pbd", "expects", {"a": 1}),
        ("solvers.json", "pbd", "expects", [1]),
    ],
)
def test_notes_of_another_kind_are_named(tmp_path, capsys, name, entry, field, value):
    folder = results(tmp_path / "r")
    (folder / name).write_text(json.dumps({entry: {field: value}}))
    assert field in named(["report", folder], folder / name, capsys)
    named(["compare", folder, folder], folder / name, capsys)


@pytest.mark.survives("spoilt results")
@pytest.mark.parametrize("data", [b"a,b\n1,2\n", b'case,solver,status\n"half', b"\xff\xfe\x00"])
def test_a_table_in_csv_that_is_none_is_named(tmp_path, data):
    (tmp_path / "runs.csv").write_bytes(data)
    with pytest.raises(ValueError, match=r"runs\.csv"):
        read(tmp_path)


@pytest.mark.survives("another schema")
def test_results_of_another_schema_are_named(tmp_path, capsys):
    folder = results(tmp_path / "r")
    table = pq.read_table(folder / "runs.parquet").replace_schema_metadata(
        {"nsbench_schema": "999"}
    )
    pq.write_table(table, folder / "runs.parquet")
    assert "schema 999" in named(["report", folder], folder / "runs.parquet", capsys)
    folder = results(tmp_path / "s")
    (folder / "env.json").write_text('{"schema": 999}')
    assert "schema 999" in named(["compare", folder, folder], folder / "env.json", capsys)


@pytest.mark.survives("another schema")
def test_a_line_of_another_schema_is_not_served_from_the_journal(tmp_path):
    journal = Journal(tmp_path)
    journal.append("a", {"x": 1.0})
    journal.close()
    path = tmp_path / "journal.jsonl"
    line = path.read_text()
    path.write_text(
        line + line.replace('"a"', '"b"').replace(f'"schema": {SCHEMA}', '"schema": 999')
    )
    assert list(read_journal(tmp_path)) == ["a"]


@pytest.mark.survives("oversized")
def test_files_far_too_large_are_named_and_not_read(tmp_path, capsys):
    """Files with nothing in them, as long as they say."""
    folder = results(tmp_path / "r")
    base = tmp_path / "b.csv"
    for path, args in (
        (folder / "env.json", ["report", folder]),
        (folder / "runs.parquet", ["report", folder]),
        (base, ["gate", folder, "--baseline", base]),
        (tmp_path / "c.py", ["run", "--cases", tmp_path / "c.py"]),
        (tmp_path / "s.py", ["run", "tide", "--solvers", tmp_path / "s.py"]),
    ):
        before = path.read_bytes() if path.exists() else b""
        with open(path, "ab") as file:
            file.truncate(5 << 30)
        assert "bytes long" in named(args, path, capsys)
        path.write_bytes(before)


@pytest.mark.survives("oversized", "spoilt reference")
def test_a_reference_that_unpacks_to_more_than_memory_is_refused(tmp_path, monkeypatch):
    from nsbench.reference import storage

    case = nsbench.get_case("three_discs")
    npz, js = reference.files_of(case, tmp_path)
    for source, path in zip(reference.files_of(case), (npz, js), strict=True):
        path.write_bytes(source.read_bytes())
    buffer = io.BytesIO()
    np.savez_compressed(buffer, x=np.zeros(1 << 21))  # 16 MB in 16 kB
    npz.write_bytes(buffer.getvalue())
    monkeypatch.setattr(storage, "ENOUGH", 1 << 20)
    with pytest.raises(reference.BadReference, match="unpacks to"):
        reference.load(case, tmp_path)


@pytest.mark.survives("no pickle")
def test_a_pickle_in_the_place_of_data_is_not_read(tmp_path, capsys):
    harm = tmp_path / "harm"
    folder = results(tmp_path / "r")
    bad = pickle.dumps(Harm(harm))
    case = nsbench.get_case("three_discs")
    npz, js = reference.files_of(case, tmp_path)
    for source, path in zip(reference.files_of(case), (npz, js), strict=True):
        path.write_bytes(source.read_bytes())
    np.savez(npz, x=np.array([Harm(harm)], dtype=object))
    with pytest.raises(reference.BadReference):
        reference.load(case, tmp_path)
    for name in ("runs.parquet", "env.json", "cases.json"):
        before = (folder / name).read_bytes()
        (folder / name).write_bytes(bad)
        named(["report", folder], folder / name, capsys)
        (folder / name).write_bytes(before)
    base = tmp_path / "b.csv"
    base.write_bytes(bad)
    named(["gate", folder, "--baseline", base], base, capsys)
    (folder / "journal.jsonl").write_bytes(bad + b"\n")
    assert read_journal(folder) == {}
    frame = pa.table({"case": ["a"]}).replace_schema_metadata({"pandas": "{}", "x": bad})
    pq.write_table(frame, folder / "runs.parquet")
    read(folder)
    assert not harm.exists()
    pickle.loads(bad).close()
    assert harm.exists()  # what reading it as a pickle would have done


@pytest.mark.survives("no pickle")
def test_nothing_that_reads_could_run_what_it_reads():
    """No module of the package imports a reader that runs code, allows pickles, or evaluates
    text."""
    words = re.compile(
        r"\b(import (pickle|marshal|shelve|dill|cloudpickle|joblib|yaml)|from "
        r"(pickle|marshal|shelve|dill|joblib)|"
        r"allow_pickle=True|read_pickle|eval\(|exec\()"
    )
    hits = [
        (str(p.relative_to(ROOT)), m[0])
        for p in ROOT.rglob("*.py")
        for m in words.finditer(p.read_text(encoding="utf-8"))
    ]
    assert hits == []
    loads = [p for p in ROOT.rglob("*.py") if "np.load(" in p.read_text(encoding="utf-8")]
    assert [p.name for p in loads] == ["storage.py"] and "allow_pickle=False" in loads[0].read_text(
        encoding="utf-8"
    )


@pytest.mark.long
@pytest.mark.survives("no pickle")
def test_only_files_that_are_named_are_run(tmp_path, capsys):
    """Beside results, and in a folder that is not asked for, no Python file is looked at."""
    folder = results(tmp_path / "r")
    harm = tmp_path / "harm"
    for name in ("tide.py", "conftest.py", "sitecustomize.py", "nsbench_local.py"):
        (folder / name).write_text(f"open({str(harm)!r}, 'w')")
    assert main(["report", str(folder)]) == 0 and not harm.exists()
    path = case_file(tmp_path)
    (tmp_path / "other.py").write_text(f"open({str(harm)!r}, 'w')")
    assert (
        main(["run", "--cases", str(path), "-s", "pbd", "--plan", "-o", str(folder)]) == 0
        and not harm.exists()
    )


@pytest.mark.long
@pytest.mark.survives("million rows")
def test_a_million_rows_make_a_report(tmp_path):
    """The table is written, read and told; memory and time grow like the rows, the page does
    not."""
    import resource
    import time

    n = 500_000
    h = np.geomspace(1e-1, 1e-6, n)
    words = {"solver": "pbd", "accuracy": "h", "status": "ok", "reference": "exact"}
    table = pa.table(
        {
            "case": np.repeat(["tide", "apple"], n),
            "h": np.tile(h, 2),
            "state_sup": np.tile(h, 2),
            **{name: [word] * (2 * n) for name, word in words.items()},
        }
    )
    pq.write_table(table, tmp_path / "runs.parquet")
    start = time.process_time()
    page = write_report(tmp_path)
    assert page.stat().st_size < 10_000_000 and "of 500000 runs were fitted" in page.read_text(
        encoding="utf-8"
    )
    assert time.process_time() - start < 60.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < 6 << 20  # kB


@pytest.mark.survives("names")
def test_text_that_looks_like_a_formula_is_no_formula_in_csv(tmp_path):
    words = ("=cmd()|' /C calc'!A0", "+1", "-2+3", "@SUM(1)", "\t=1", "fine")
    rows = [
        row("tide", "pbd", 0.1, status="error", why=w) | {w: 1.0} for w in words
    ]  # a solver names what it counts
    store.write_tables(tmp_path, rows)
    lines = (tmp_path / "runs.csv").read_text(encoding="utf-8")
    assert not re.search(r"(^|,)\"?[=+@\t]", lines) and "'=cmd()" in lines
    (tmp_path / "runs.parquet").unlink()
    assert {"'=cmd()|' /C calc'!A0", "'+1", "'\t=1", "case"} <= {
        *next(csv.reader(lines.splitlines()))
    }
    back = read(tmp_path).runs["tide", "pbd"].col["why"]
    assert "=cmd()|' /C calc'!A0" in back and "fine" in back


def test_a_reason_that_looks_like_a_formula_is_refused(tmp_path, capsys):
    folder = results(tmp_path / "r")
    assert main(["gate", str(folder), "--baseline", "b.csv", "--update", "--reason", "=1+1"]) == 2
    assert "'=1+1'" in capsys.readouterr().err


@pytest.mark.survives("read-only")
def test_a_folder_that_cannot_be_written_to_is_an_error_before_anything_runs(tmp_path, capsys):
    places = ["/proc/nsbench", "/sys/nsbench"] if os.path.isdir("/proc") else []
    locked = tmp_path / "locked"
    locked.mkdir()
    locked.chmod(0o555)
    if os.geteuid():
        places.append(str(locked / "r"))
    for place in places:
        assert main(["run", "tide", "-s", "pbd", "--h", "0.1", "-o", place]) == 2
        assert place in capsys.readouterr().err
    assert places


@pytest.mark.long
@pytest.mark.survives("output is a file")
def test_an_output_that_is_a_link(tmp_path, capsys):
    """To nowhere: an error; to a folder: the folder."""
    (tmp_path / "link").symlink_to(tmp_path / "nowhere")
    assert main(["run", "tide", "-s", "pbd", "--h", "0.1", "-o", str(tmp_path / "link")]) == 2
    assert "nowhere" in capsys.readouterr().err
    (tmp_path / "nowhere").mkdir()
    assert (
        main(["run", "tide", "-s", "pbd", "--h", "0.1", "-j", "1", "-o", str(tmp_path / "link")])
        == 0
    )
    assert (tmp_path / "nowhere" / "runs.csv").exists() and (tmp_path / "link").is_symlink()
