"""A row is kept under its key only if it is certain what made it: nobody edited a file, or data
that it read, meanwhile."""

import os
import threading
import time

import pytest
from solver_file import solver

from nsbench.cli import main
from nsbench.results.journal import read_journal
from nsbench.source_files import file_state, opened_files

DATA = 'c = float(open(os.path.join(os.path.dirname(__file__), "data", "table.txt")).read())'


def run(file, out, *more):
    return main(
        [
            "run",
            "tide",
            "--solvers",
            str(file),
            "-s",
            "mine",
            "--h",
            "0.1",
            "-j",
            "1",
            "-o",
            str(out),
            *more,
        ]
    )


def rows(out):
    return [r for k, r in read_journal(out).items() if len(k) == 64]


def edited(out, edit):
    """A thread that edits when the keys have been made and no worker has loaded anything."""

    def wait():
        until = time.monotonic() + 30
        while not (out / "journal.jsonl").exists() and time.monotonic() < until:
            time.sleep(0.002)
        edit()

    thread = threading.Thread(target=wait)
    thread.start()
    return thread


@pytest.mark.long
@pytest.mark.survives("stale")
@pytest.mark.parametrize("put_back", ["after", "during"])
def test_a_file_that_is_edited_while_runs_are_made_leaves_no_row_that_is_served(
    tmp_path, capsys, put_back
):
    """The key is that of the first text, the worker loads the second."""
    file = tmp_path / "mine.py"
    out = tmp_path / "r"
    go = tmp_path / "go"
    loaded = tmp_path / "loaded"
    wait = f"while not os.path.exists({str(go)!r}): time.sleep(0.01)"
    first = solver(wait, stats='{"mark": 1}')
    second = solver(wait, stats='{"mark": 2}', before=f"open({str(loaded)!r}, 'w').close()")
    file.write_text(first)
    os.utime(file, (1e9, 1e9))

    def edit():
        os.rename(file, tmp_path / "kept")
        file.write_text(second)
        if put_back == "during":
            until = time.monotonic() + 30
            while not loaded.exists() and time.monotonic() < until:
                time.sleep(0.01)
            os.rename(tmp_path / "kept", file)  # the same file at the same place, its times too
        go.write_text("")

    thread = edited(out, edit)
    assert run(file, out) == 3
    thread.join()
    assert "mine.py changed while runs were made: 1 rows are unverified" in capsys.readouterr().out
    assert read_journal(out) and not rows(out)
    (shown,) = read_journal(out).values()
    assert (
        shown["status"] == "unverified"
        and "mine.py changed while runs were made" in shown["why"]
        and shown["mark"] == 2
    )
    file.write_text(first)
    assert (
        run(file, out, "--plan") == 0 and "mine.py changed while it ran" in capsys.readouterr().out
    )
    assert run(file, out) == 0
    assert [r["mark"] for r in rows(out)] == [1]
    assert run(file, out, "--plan") == 0 and "0 to run, 1 known" in capsys.readouterr().out


@pytest.mark.long
@pytest.mark.survives("stale")
@pytest.mark.parametrize(
    "text",
    [DATA, f"if not hasattr(sys, 'c'):\n    {DATA}\n    sys.c = c\nc = sys.c"],
    ids=["each", "once"],
)
def test_data_that_a_run_reads_are_compared_before_its_row_is_served(tmp_path, capsys, text):
    file = tmp_path / "mine.py"
    out = tmp_path / "r"
    file.write_text(solver(text, stats='{"mark": c}'))
    (tmp_path / "data").mkdir()
    data = tmp_path / "data" / "table.txt"
    data.write_text("1.0")
    run(file, out, "--h", "0.1,0.05,0.025")
    assert [r["mark"] for r in rows(out)] == [1.0] * 3 and "read" not in rows(out)[0]
    capsys.readouterr()
    run(file, out, "--h", "0.1,0.05,0.025", "--plan")
    assert "0 to run, 3 known" in capsys.readouterr().out
    data.write_text("2.0")
    run(file, out, "--h", "0.1,0.05,0.025", "--plan")
    assert "3  data/table.txt changed" in capsys.readouterr().out
    run(file, out, "--h", "0.1,0.05,0.025")
    assert [r["mark"] for r in rows(out)] == [2.0] * 3
    data.unlink()
    assert run(file, out) == 3  # and not what was computed when there was such a file
    assert "FileNotFoundError" in rows(out)[0]["why"]


@pytest.mark.long
@pytest.mark.survives("stale")
def test_data_that_change_while_the_run_goes_on_make_its_row_uncertain(tmp_path, capsys):
    file = tmp_path / "mine.py"
    out = tmp_path / "r"
    data = tmp_path / "table.txt"
    data.write_text("1.0")
    file.write_text(
        solver(
            """
    c = float(open(os.path.join(os.path.dirname(__file__), "tab" + "le.txt")).read())
    os.system(f"echo 2.0 > {os.path.dirname(__file__)}/table.txt")
""",
            stats='{"mark": c}',
        )
    )
    assert run(file, out) == 3 and not rows(out)
    assert "table.txt changed while runs were made" in capsys.readouterr().out


@pytest.mark.long
def test_what_a_run_writes_itself_is_no_data_of_it(tmp_path):
    file = tmp_path / "mine.py"
    out = tmp_path / "r"
    file.write_text(
        solver("""
    place = os.path.join(os.path.dirname(__file__), "no" + "tes.txt")
    seen = open(place).read() if os.path.exists(place) else ""
    open(place, "w").write(seen + "x")
""")
    )
    assert run(file, out) == 0 and len(rows(out)) == 1


@pytest.mark.survives("disk full", "stale")
@pytest.mark.parametrize(
    "fault",
    [
        "raise OSError(28, 'No space left on device')",
        "open('/nowhere/at all')",
        """
try:
    raise OSError(24, "Too many open files")
except OSError as e:
    raise ImportError("no module") from e
""",
        "raise ImportError('libx.so: cannot open shared object file: Too many open files')",
    ],
    ids=["disk", "missing", "behind another", "in words"],
)
def test_a_fault_of_the_machine_is_no_result(tmp_path, capsys, fault, runs_here):
    file = tmp_path / "mine.py"
    out = tmp_path / "r"
    full = tmp_path / "full"
    lines = "\n".join("    " + line for line in fault.strip().splitlines())
    file.write_text(
        solver(f"if os.path.exists(os.path.dirname(__file__) + '/fu' + 'll'):\n{lines}")
    )
    full.write_text("")
    assert run(file, out) == 3 and [r["status"] for r in rows(out)] == ["error"]
    full.unlink()
    assert run(file, out) == 0 and [r["status"] for r in rows(out)] == ["ok"]


def test_an_error_of_the_run_itself_is_one(tmp_path, capsys, runs_here):
    file = tmp_path / "mine.py"
    out = tmp_path / "r"
    file.write_text(solver("raise ValueError('no')"))
    assert run(file, out) == 3
    capsys.readouterr()
    assert run(file, out, "--plan") == 0 and "0 to run, 1 known" in capsys.readouterr().out


def test_a_touch_is_seen_though_text_size_and_times_are_as_before(tmp_path):
    file = tmp_path / "a"
    other = tmp_path / "b"
    file.write_text("1")
    path = str(file)
    before = os.stat(file)
    try:
        file_state.record_state(path)
        assert file_state.changed_files([path]) == []
        file.write_text("2")
        os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
        assert file_state.changed_files([path]) == [path] and file_state.changed_files(
            [str(other)]
        ) == [str(other)]
    finally:
        file_state.forget()


def test_files_that_are_opened_for_writing_are_not_read(tmp_path):
    file = tmp_path / "own.py"
    place = str(tmp_path / "x")
    with opened_files.record_opens_of_run(str(file)):
        os.close(os.open(place, os.O_WRONLY | os.O_CREAT))
    assert opened_files.digests_of_data_read(file, lambda p: True) == {}
    (tmp_path / "y").write_text("1")
    with opened_files.record_opens_of_run(str(file)):
        os.close(os.open(tmp_path / "y", os.O_RDONLY))
    assert [*opened_files.digests_of_data_read(file, lambda p: True)] == ["y"]


def test_what_loading_opens_is_not_read_by_the_run_that_loads_first(tmp_path):
    """Its row says the same as that of a run which finds the file loaded."""
    file, table, later = (tmp_path / name for name in ("case.py", "table.txt", "later.txt"))
    for f in (file, table, later):
        f.write_text("1")
    with opened_files.record_opens_of_run(str(file)):
        with opened_files.record_opens_while_loading(file):
            file.read_text(), table.read_text()
        later.read_text()
    assert [*opened_files.digests_of_data_read(file, lambda p: True)] == ["later.txt"]


def test_data_of_a_folder_whose_name_begins_alike_are_not_of_this_one(tmp_path):
    for name in ("mine", "mine2"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "data.txt").write_text(name)
    case = tmp_path / "mine" / "case.py"
    with opened_files.record_opens_of_run(str(case)):
        for name in ("mine", "mine2"):
            (tmp_path / name / "data.txt").read_text()
    assert [*opened_files.digests_of_data_read(case, lambda path: True)] == ["data.txt"]
