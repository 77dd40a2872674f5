"""Ctrl-C, once or twice, SIGTERM and kill -9: nobody is left, the journal is whole, and the next
call goes on from it."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from solver_file import solver

sys.path.insert(0, str(Path(__file__).parents[1] / "studies"))
import kills

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/environ").exists(), reason="processes are looked up in /proc"
)

SOLVER = solver("""
    if h < 0.01:
        ctypes.PyDLL(None).sleep(1000)
""")


@pytest.mark.long
@pytest.mark.survives("ctrl-c")
@pytest.mark.parametrize(
    "signals",
    [
        (signal.SIGINT,),
        (signal.SIGINT, signal.SIGINT),
        (signal.SIGTERM,),
        (signal.SIGTERM, signal.SIGINT, signal.SIGTERM),
        (signal.SIGKILL,),
    ],
    ids=lambda s: "+".join(x.name for x in s),
)
def test_a_suite_that_is_stopped_leaves_nobody_and_a_whole_journal(tmp_path, signals):
    file = tmp_path / "slow.py"
    out = tmp_path / "out"
    file.write_text(SOLVER)
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "nsbench",
            "run",
            "tide",
            "-s",
            "slow",
            "--solvers",
            str(file),
            "--h",
            "0.05,0.025,0.005",
            "-j",
            "1",
            "-o",
            str(out),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {kills.MARK: str(tmp_path)},
        start_new_session=True,
    )
    while (
        len([line for line in kills.lines(out) if b'"key"' in line]) < 2
    ):  # the third one is at work, or will be
        assert process.poll() is None
        time.sleep(0.05)
    time.sleep(0.3)
    assert len(kills.marked(str(tmp_path))) >= 2
    for s in signals:
        os.killpg(process.pid, s)  # as a terminal does: to all of its group
        time.sleep(0.02)
    _, said = process.communicate(timeout=30)
    assert process.returncode == (-signal.SIGKILL if signal.SIGKILL in signals else 130)
    assert "Traceback" not in said and said.count("interrupted") == (signal.SIGKILL not in signals)
    end = time.monotonic() + 5.0
    while kills.marked(str(tmp_path)) and time.monotonic() < end:
        time.sleep(0.02)
    assert kills.marked(str(tmp_path)) == []
    entries = [json.loads(line) for line in kills.lines(out)]
    assert [e["row"]["status"] for e in entries if "key" in e] == [
        "ok",
        "ok",
    ]  # and none that was stopped is a crash


def test_a_signal_between_two_rows_waits_for_the_second(tmp_path):
    from nsbench.execute.workers import signals as stop

    done = []
    with pytest.raises(KeyboardInterrupt), stop.stop_signals():
        with stop.defer_signals():
            os.kill(os.getpid(), signal.SIGINT)
            done.append("row")
            stop.check()
            done.append("next")
    assert done == ["row"]
    with stop.stop_signals():
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(1)
        os.kill(os.getpid(), signal.SIGINT)  # the second one changes nothing
        done.append("clean")
    assert (
        done == ["row", "clean"] and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    )


def test_signals_that_are_ignored_stay_so():
    from nsbench.execute.workers import signals as stop

    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stop.stop_signals():
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
            os.kill(os.getpid(), signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)
