"""Code of a user's file that runs in the command itself can neither end it nor hold it up
silently."""

import subprocess
import sys
import threading
import time

import pytest
from solver_file import solver

from nsbench import user_code
from nsbench.results.journal import read_journal


def run(folder, *args):
    """The command in a process of its own, which a file might end."""
    return subprocess.run(
        [sys.executable, "-m", "nsbench", *args],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
    )


@pytest.mark.survives("broken plugin")
@pytest.mark.parametrize("kind", ("case", "solver"))
def test_a_file_that_ends_its_process_where_it_is_loaded_is_an_error_that_names_it(tmp_path, kind):
    file = tmp_path / "leaves.py"
    file.write_text(solver("pass", before="os._exit(0)"))
    named = (
        ("--cases", str(file), "-s", "pbd")
        if kind == "case"
        else ("tide", "-s", "leaves", "--solvers", str(file))
    )
    done = run(tmp_path, "run", *named, "--h", "0.1", "-o", str(tmp_path / "r"))
    assert done.returncode == 2 and "leaves.py" in done.stderr and "os._exit(0)" in done.stderr


@pytest.mark.survives("broken plugin", "death")
def test_a_file_that_crashes_in_c_where_it_is_loaded_is_named_by_the_traceback(tmp_path):
    file = tmp_path / "crashes.py"
    file.write_text(solver("pass", before="ctypes.string_at(0)"))
    done = run(
        tmp_path,
        "run",
        "tide",
        "-s",
        "crashes",
        "--solvers",
        str(file),
        "--h",
        "0.1",
        "-o",
        str(tmp_path / "r"),
    )
    assert (
        done.returncode < 0
        and "Segmentation fault" in done.stderr
        and 'crashes.py", line' in done.stderr
    )


@pytest.mark.long
@pytest.mark.survives("death")
@pytest.mark.parametrize(
    "does, status",
    (
        ("os._exit(0)", "crashed"),
        ("raise KeyError('nowhere')", "error"),
        ("__import__('sys').exit(0)", "crashed"),
    ),
)
def test_a_method_that_fails_where_it_is_asked_what_it_refuses_has_its_row(tmp_path, does, status):
    file = tmp_path / "asked.py"
    file.write_text(solver("pass").replace("return None\n", f"{does}\n", 1))
    done = run(
        tmp_path,
        "run",
        "tide",
        "-s",
        "asked",
        "-s",
        "pbd",
        "--solvers",
        str(file),
        "--h",
        "0.1",
        "-j",
        "1",
        "-o",
        str(tmp_path / "r"),
    )
    assert done.returncode == 3, done.stderr  # a run has failed; the others went on
    found = {r["solver"]: r["status"] for r in read_journal(tmp_path / "r").values()}
    assert found["asked"] == status and found["pbd"] in ("ok", "below_reference")


ASKED = """import os, threading, time
from nsbench import user_code
with user_code.guarded("a file"):
    {}
"""
CHILD = """if os.fork() == 0:
        os._exit(5)
    assert os.waitstatus_to_exitcode(os.wait()[1]) == 5
    os._exit(3)"""
THREAD = "threading.Thread(target=os._exit, args=(7,)).start(); time.sleep(5)"


@pytest.mark.parametrize(
    "does, status, said", ((CHILD, 1, "UserCodeExit: a file calls os._exit(3)"), (THREAD, 7, ""))
)
def test_only_the_thread_that_asks_is_kept_from_leaving(does, status, said):
    done = subprocess.run(
        [sys.executable, "-c", ASKED.format(does)], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == status and said in done.stderr


def test_what_takes_long_says_who_is_at_work(capfd, monkeypatch):
    monkeypatch.setattr(user_code, "SECONDS_BEFORE_NOTICE", 0.05)
    with user_code.guarded("slow.py"):
        time.sleep(0.4)
    assert "slow.py is still at work after 0.05 s" in capfd.readouterr().err
    with user_code.guarded("quick.py"):
        pass
    time.sleep(0.2)
    assert "quick.py" not in capfd.readouterr().err and not [
        t for t in threading.enumerate() if isinstance(t, threading.Timer)
    ]
