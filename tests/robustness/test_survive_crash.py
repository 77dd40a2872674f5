"""A suite that is killed, or that has no room left on the disk, leaves whole lines and goes on from
them."""

import csv
import errno
import json
import os
import signal
import subprocess
import sys
import time

import pytest

from nsbench import columns
from nsbench.cli import main
from nsbench.results.journal import read_journal

ARGS = ["run", "tide", "apple", "-s", "pbd", "-j", "1"]
TIMES = {*columns.names("clock")}


def numbers(folder):
    with open(folder / "runs.csv", newline="", encoding="utf-8") as file:
        return [{k: v for k, v in r.items() if k not in TIMES} for r in csv.DictReader(file)]


def whole(folder):
    """Keys in the journal, every line of which can be read."""
    lines = (folder / "journal.jsonl").read_bytes().split(b"\n")
    assert lines[-1] == b"" and all(json.loads(line) for line in lines[:-1])
    return set(read_journal(folder))


def stopped(out, *signals):
    """The exit code of a suite that gets these signals when its journal holds two rows."""
    p = subprocess.Popen(
        [sys.executable, "-m", "nsbench", *ARGS, "-o", str(out)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        for _ in range(3000):  # kernels may have to be compiled first, on a machine with other work
            if out.exists() and (out / "journal.jsonl").exists() and len(read_journal(out)) >= 2:
                break
            time.sleep(0.1)
        for s in signals:
            os.killpg(p.pid, s)
            time.sleep(0.1)
        return p.wait(60)
    finally:
        p.kill()
        p.wait()


@pytest.mark.long
@pytest.mark.survives("ctrl-c")
def test_two_interrupts_tear_nothing(tmp_path):
    """Of 38 runs two have ended: the rest takes far longer than the signals."""
    assert stopped(tmp_path, signal.SIGINT, signal.SIGINT) == 130 and len(whole(tmp_path)) >= 2


@pytest.mark.long
@pytest.mark.survives("kill")
def test_a_suite_that_is_killed_goes_on_and_ends_with_the_same_numbers(tmp_path):
    """The study of fifty kills is tests/studies/kills.py."""
    out = tmp_path / "r"
    calm = tmp_path / "calm"
    stopped(out, signal.SIGKILL)
    done = set(read_journal(out))
    assert len(done) >= 2
    assert main([*ARGS, "-o", str(out)]) == 0
    assert done <= whole(out)
    assert main([*ARGS, "-o", str(calm)]) == 0
    assert numbers(out) == numbers(calm) and len(numbers(out)) >= 36


class Full:
    """A disk that takes `calls` more writes to the results and then no byte; half of one is taken
    before."""

    def __init__(self, folder, calls, monkeypatch):
        self.folder = str(folder)
        self.calls = calls
        self.write = os.write
        self.sync = os.fsync
        monkeypatch.setattr(os, "write", self.half)
        monkeypatch.setattr(os, "fsync", self.synced)

    def _ours(self, fd):
        try:
            return os.readlink(f"/proc/self/fd/{fd}").startswith(self.folder)
        except OSError:
            return False

    def half(self, fd, data):
        if self._ours(fd) and self.calls <= 0:
            if len(data) > 40:
                return self.write(fd, bytes(data)[:20])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return self.write(fd, data)

    def synced(self, fd):
        if self._ours(fd):
            if self.calls <= 0:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            self.calls -= 1
        return self.sync(fd)


@pytest.mark.survives("disk full")
@pytest.mark.skipif(
    not os.path.isdir("/proc/self/fd"), reason="tells files of the results by /proc"
)
@pytest.mark.parametrize("calls", [3, 6, 8])
def test_a_full_disk_ends_the_suite_with_5_and_leaves_no_half_file(
    tmp_path, monkeypatch, capsys, calls, runs_here
):
    """While rows are written, and while tables are: five rows, then three files."""
    out = tmp_path / "r"
    args = ["run", "tide", "-s", "pbd", "--h", "0.05,0.025,0.0125", "-j", "1", "-o", str(out)]
    with monkeypatch.context() as m:
        Full(out, calls, m)
        assert main(args) == 5
    assert "No space left" in capsys.readouterr().err
    kept = whole(out)
    assert (
        not [p for p in out.rglob(".*") if p.name != ".report.key"]
        and not (out / "report.html").exists()
    )
    assert main(args) == 0
    assert kept <= whole(out) and len(numbers(out)) == 3
