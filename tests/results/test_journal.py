"""What a kill, a full disk or a loss of power leaves of a journal is dropped and mended; nothing
whole is lost."""

import errno
import json
import os
import subprocess
import sys

import pytest

from nsbench.cli import main
from nsbench.gate import spreads
from nsbench.results import consistency, journal
from nsbench.results.atomic_write import StoreError, write_atomically
from nsbench.results.journal import Journal, read_journal


def write(folder, **rows):
    j = Journal(folder)
    for key, value in rows.items():
        j.append(key, {"x": value, "status": "ok"})
    j.close()
    return folder / "journal.jsonl"


def test_a_block_of_zeros_takes_with_it_what_it_overwrote_and_no_more(tmp_path):
    path = write(tmp_path, a=1.0, b=2.0, c=3.0, d=4.0)
    data = path.read_bytes()
    lines = data.splitlines(keepends=True)
    b = len(lines[0])
    c = len(lines[0]) + len(lines[1])
    for begin, end, kept in (
        (b + 5, b + 20, "acd"),
        (b + 5, c + 9, "ad"),
        (0, c, "cd"),
        (c, len(data), "ab"),
        (len(data) - 1, len(data), "abcd"),
        (b - 1, b, "abcd"),
        (0, len(data), ""),
    ):
        path.write_bytes(data[:begin] + bytes(end - begin) + data[end:])
        damaged = []
        assert "".join(read_journal(tmp_path, damaged)) == kept
        assert len(damaged) <= 2
        write(tmp_path, e=5.0)
        assert "".join(read_journal(tmp_path)) == (
            kept + "e" if (begin, end) != (len(data) - 1, len(data)) else "abce"
        )


@pytest.mark.survives("half a line")
@pytest.mark.parametrize("cut", [1, 2, 20, 60])
def test_a_torn_end_is_cut_off_and_the_next_line_is_whole(tmp_path, cut):
    path = write(tmp_path, a=1.0, b=2.0)
    path.write_bytes(path.read_bytes()[:-cut] + bytes(3))
    write(tmp_path, c=3.0)
    assert list(read_journal(tmp_path)) == ["a", "c"]
    for line in path.read_bytes().splitlines():
        json.loads(line)


@pytest.mark.survives("half a line")
def test_a_line_that_is_not_as_it_was_written_is_dropped(tmp_path):
    path = write(tmp_path, a=1.5, b=2.5)
    path.write_bytes(path.read_bytes().replace(b"1.5", b"1.6"))
    damaged = []
    assert list(read_journal(tmp_path, damaged)) == ["b"] and damaged == [1]


def test_lines_without_a_checksum_are_of_an_older_version(tmp_path):
    tmp_path.joinpath("journal.jsonl").write_text('{"schema": 1, "key": "a", "row": {"x": 1.0}}\n')
    assert read_journal(tmp_path) == {"a": {"x": 1.0}}


def test_a_full_disk_leaves_whole_lines(tmp_path, monkeypatch):
    path = write(tmp_path, a=1.0)
    before = path.read_bytes()
    plain = os.write

    def full(fd, data):
        plain(fd, bytes(data)[:10])  # what still fits
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    j = Journal(tmp_path)
    monkeypatch.setattr(journal.os, "write", full)
    with pytest.raises(StoreError, match="No space left"):
        j.append("b", {"x": 2.0})
    monkeypatch.undo()
    assert path.read_bytes() == before
    j.append("c", {"x": 3.0})
    j.close()
    assert list(read_journal(tmp_path)) == ["a", "c"]


def test_of_rows_appended_together_a_full_disk_keeps_those_that_fit(tmp_path, monkeypatch):
    path = write(tmp_path, a=1.0)
    plain = os.write

    def full(fd, data):
        if len(data) < 200:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return plain(fd, bytes(data)[: len(data) - 50])  # the last row does not fit

    j = Journal(tmp_path)
    monkeypatch.setattr(journal.os, "write", full)
    with pytest.raises(StoreError, match="No space left"):
        j.append_all([(key, {"x": 2.0, "status": "ok"}, ()) for key in "bcd"])
    monkeypatch.undo()
    j.append("e", {"x": 3.0})
    j.close()
    damaged = []
    assert list(read_journal(tmp_path, damaged)) == ["a", "b", "c", "e"] and not damaged
    assert path.read_bytes().endswith(b"\n")


def test_a_table_that_cannot_be_written_leaves_the_old_one(tmp_path, monkeypatch):
    write_atomically(tmp_path / "f", b"old")

    for error in (OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()):

        def fails(fd, error=error):
            raise error

        monkeypatch.setattr(journal.os, "fsync", fails)
        with pytest.raises((StoreError, KeyboardInterrupt)):
            write_atomically(tmp_path / "f", b"new")
        assert [p.name for p in tmp_path.iterdir()] == ["f"] and (
            tmp_path / "f"
        ).read_bytes() == b"old"


def test_what_a_killed_process_left_beside_its_tables_is_cleared_away(tmp_path):
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    (tmp_path / f".runs.csv.{gone.pid}").write_text("half")
    (tmp_path / f".runs.csv.{os.getpid()}").write_text("at work")
    (tmp_path / ".report.key").write_text("kept")
    write(tmp_path, a=1.0)
    assert {p.name for p in tmp_path.iterdir()} == {
        "journal.jsonl",
        ".report.key",
        f".runs.csv.{os.getpid()}",
    }


@pytest.mark.survives("kill")
def test_what_a_kill_left_of_reports_and_figures_is_cleared_by_the_next_run(tmp_path):
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    names = [*consistency.FILES, consistency.KEY_FILE, spreads.NAME, "report.html", "report.md"]
    left = [
        f".report.html.{gone.pid}",
        ".report.html.a1b2c3d4",
        ".report.md._______8",
        f"figures/.scene_tide.svg.{gone.pid}",
        "figures/.tide_state.svg.xyz01234",
        f"figures/.{'n' * 40}.abcdefgh",
        f"output/.tide.txt.{gone.pid}",
        f"output/.{'n' * 40}.{gone.pid}",
        *(f".{name}.{gone.pid}" for name in names),
        f".report.key.{gone.pid}",
    ]
    kept = [
        f".report.html.{os.getpid()}",
        "report.html",
        ".report.key",
        "figures/scene_tide.svg",
        "figures/.notes.markdown",
        f"figures/.scene.svg.{os.getpid()}",
        "output/tide.txt",
        "mine/.tide.svg.xyz01234",
        f".env.{gone.pid}",
        f".notes.txt.{gone.pid}",
        f".env.json.mine.{gone.pid}",
        f"figures/.env.{gone.pid}",
        f".runs.csv.{gone.pid + 10**9}/mine",
        f".{'n' * 40}.{gone.pid}",
    ]
    for name in (*left, *kept):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("")
    write(tmp_path, a=1.0)
    there = {p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*") if p.is_file()}
    assert there == {*kept, "journal.jsonl"}


@pytest.mark.long
@pytest.mark.survives("disk full", "kill")
def test_every_file_of_a_results_folder_is_written_beside_and_renamed(tmp_path, monkeypatch):
    """No file but the journal and the key's mark is ever opened for writing under the name that it
    is read by."""
    import builtins
    import io

    out = tmp_path / "r"
    seen = []
    plain = io.open
    low = os.open
    renamed = os.replace

    def noted(file, mode="r", *args, **more):
        seen.extend([str(file)] * (set(mode) & set("wax+") != set()))
        return plain(file, mode, *args, **more)

    def noted_low(path, flags, *args, **more):
        seen.extend([str(path)] * (flags & (os.O_WRONLY | os.O_RDWR) != 0))
        return low(path, flags, *args, **more)

    monkeypatch.setattr(builtins, "open", noted)
    monkeypatch.setattr(io, "open", noted)
    monkeypatch.setattr(os, "open", noted_low)
    into = []
    monkeypatch.setattr(os, "replace", lambda a, b: (into.append(str(b)), renamed(a, b)))
    from nsbench.execute import suite

    monkeypatch.setattr(
        suite, "_chores", lambda cases, out, specs: []
    )  # pictures are drawn here, where they are seen
    assert main([*RUN, str(out)]) == 0
    there = {str(p) for p in out.rglob("*") if p.is_file()} - {str(out / "journal.jsonl")}
    assert len(there) >= 10 and there == {p for p in into if p.startswith(str(out))}
    assert {
        p for p in seen if p.startswith(str(out)) and not os.path.basename(p).startswith(".")
    } == {str(out / "journal.jsonl")}


RUN = ("run", "tide", "-s", "pbd", "--h", "0.05,0.025", "-j", "1", "-o")


@pytest.mark.survives("output is a file")
def test_a_folder_that_cannot_be_one_is_told_before_anything_runs(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    (tmp_path / "dangling").symlink_to(tmp_path / "nothing")
    (tmp_path / "to_file").symlink_to(tmp_path / "file")
    (tmp_path / "linked").mkdir()
    (tmp_path / "linked" / "journal.jsonl").symlink_to(tmp_path / "file")
    (tmp_path / "piped").mkdir()
    os.mkfifo(tmp_path / "piped" / "journal.jsonl")
    for name, words in (
        ("file", "is a file"),
        ("dangling", "does not exist"),
        ("to_file", "a link to a file"),
        ("linked", "is a link"),
        ("piped", "no plain file"),
        ("file/below", "cannot write to"),
    ):
        assert main([*RUN, str(tmp_path / name)]) == 2
        assert words in capsys.readouterr().err
    assert (tmp_path / "file").read_text() == ""


@pytest.mark.survives("read-only")
def test_a_folder_that_may_not_be_written_is_told_as_usage(tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    plain = os.open

    def refuses(path, *args, **more):
        if str(path).startswith(str(out)):
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return plain(path, *args, **more)

    monkeypatch.setattr(journal.os, "open", refuses)
    assert main([*RUN, str(out)]) == 2
    assert "Permission denied" in capsys.readouterr().err


@pytest.mark.long
@pytest.mark.survives("disk full")
@pytest.mark.skipif(os.name != "posix", reason="limits of POSIX")
def test_a_run_that_meets_a_full_disk_ends_with_5_and_is_taken_up_again(tmp_path):
    """A limit on the size of files stands for a disk: what is written beyond it fails."""
    out = tmp_path / "out"
    code = (
        "import resource, sys; from nsbench.cli import main\n"
        "if __name__ == '__main__':\n    resource.setrlimit(resource.RLIMIT_FSIZE, (12_000, "
        "resource.RLIM_INFINITY))\n"
        "    sys.exit(main(sys.argv[1:]))"
    )
    (tmp_path / "limited.py").write_text(code)
    env = {
        k: v for k, v in os.environ.items() if not k.startswith("COVERAGE_")
    }  # its files would meet the limit as well
    full = subprocess.run(
        [sys.executable, str(tmp_path / "limited.py"), *RUN[:5], "5e-2..1e-3", *RUN[6:], str(out)],
        capture_output=True,
        text=True,
        env=env,
    )
    assert (
        full.returncode == 5 and "File too large" in full.stderr and "Traceback" not in full.stderr
    )
    data = (out / "journal.jsonl").read_bytes()
    assert data.endswith(b"\n") and len(data) <= 12_000
    for line in data.splitlines():
        json.loads(line)
    assert not [p for p in out.rglob(".*") if p.is_file()] and not (out / "runs.csv").exists()


@pytest.mark.survives("half a line")
@pytest.mark.parametrize("zeros", [1, 3, 29, 70_000])
def test_zeros_before_the_last_end_of_a_line_cost_no_line_that_follows(
    tmp_path, monkeypatch, zeros
):
    path = write(tmp_path, a=1.0, b=2.0)
    data = path.read_bytes()
    for block in (7, 1 << 20):
        monkeypatch.setattr(journal, "BLOCK", block)
        path.write_bytes(data[:-30] + bytes(zeros) + b"\n")
        write(tmp_path, c=3.0)
        damaged = []
        assert list(read_journal(tmp_path, damaged)) == ["a", "c"] and damaged == [2]
        path.write_bytes(data[:-1] + bytes(zeros) + b"\n")
        write(tmp_path, c=3.0)
        assert list(read_journal(tmp_path)) == ["a", "b", "c"]


@pytest.mark.survives("half a line")
@pytest.mark.parametrize("block", [1, 5, 64, 1000])
def test_a_journal_is_read_and_mended_the_same_in_blocks_of_any_size(tmp_path, monkeypatch, block):
    whole = write(tmp_path, a=1.0, b=2.0, c=3.0).read_bytes()
    monkeypatch.setattr(journal, "BLOCK", block)
    for tail in (
        b"",
        b"\n\n",
        b"half",
        b"\0\0",
        b"\0\nhalf\0",
        bytes(3000) + b"\n",
        b"\n" + bytes(3000),
    ):
        (tmp_path / "journal.jsonl").write_bytes(whole + tail)
        Journal(tmp_path).close()
        assert (tmp_path / "journal.jsonl").read_bytes() == whole, tail
        (tmp_path / "journal.jsonl").write_bytes(whole[:40] + bytes(50) + whole[40:] + tail)
        assert list(read_journal(tmp_path)) == ["b", "c"]
    for nothing in (b"", b"\n", b"\0", b"half", bytes(3000) + b"\n\0"):
        (tmp_path / "journal.jsonl").write_bytes(nothing)
        Journal(tmp_path).close()
        assert (tmp_path / "journal.jsonl").read_bytes() == b""


@pytest.mark.survives("oversized")
def test_a_line_that_no_journal_has_is_refused_by_its_number(tmp_path, monkeypatch, capsys):
    path = write(tmp_path, a=1.0)
    monkeypatch.setattr(journal, "LONGEST", 1000)
    monkeypatch.setattr(journal, "BLOCK", 300)
    path.write_bytes(path.read_bytes() + bytes(5000) + b"\n")  # zeros are no line
    write(tmp_path, b=2.0)
    assert list(read_journal(tmp_path)) == ["a", "b"]
    path.write_bytes(path.read_bytes() + b"x" * 1000 + b"\n")
    assert list(read_journal(tmp_path)) == ["a", "b"]
    path.write_bytes(path.read_bytes() + b"x" * 1001 + b"\n")
    with pytest.raises(ValueError, match=r"line \d of .*journal\.jsonl is longer than 1000 bytes"):
        read_journal(tmp_path)
    assert main([*RUN, str(tmp_path)]) == 2
    assert "journal.jsonl is longer than 1000 bytes" in capsys.readouterr().err


def test_nobody_may_execute_what_a_run_writes(tmp_path):
    """Whatever the process masks."""
    (tmp_path / "runs.csv").touch()
    mask = os.umask(0)
    try:
        write(tmp_path, a=1.0)
        consistency.mark_stale(tmp_path)
    finally:
        os.umask(mask)
    for name in ("journal.jsonl", consistency.KEY_FILE):
        assert (tmp_path / name).stat().st_mode & 0o777 == 0o666, name


def test_a_row_is_on_the_disk_before_it_counts(tmp_path, monkeypatch):
    synced = []
    real = os.fsync
    monkeypatch.setattr(os, "fsync", lambda number: synced.append(real(number)))
    lines = Journal(tmp_path)
    synced.clear()
    lines.append("a", {"status": "ok"})
    assert len(synced) == 1
    lines.close()


@pytest.mark.parametrize(
    "row, timeout, final",
    (
        ({"status": "timeout"}, 0.5, False),  # of an older version: its limit is not known
        ({"status": "timeout", "limit": 2.0}, 1.0, True),
        ({"status": "timeout", "limit": 2.0}, 3.0, False),
        ({"status": "timeout", "limit": 2.0}, None, False),
    ),
)
def test_a_timeout_is_final_for_limits_up_to_its_own(row, timeout, final):
    assert journal.settled(row, timeout) is final
