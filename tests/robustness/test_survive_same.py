"""The same suite gives the same numbers, by one worker or two, in fresh processes; a scene that
chatters takes no other along."""

import os
import subprocess
import sys

import pytest
from survive_files import case_file

from nsbench import columns
from nsbench.cli import main
from nsbench.results.journal import read_journal

TIMES = {*columns.names("clock")}


@pytest.fixture(scope="module")
def standard():
    """Methods of the standard suite, of a process in which no test has loaded others."""
    asked = [
        sys.executable,
        "-c",
        "from nsbench import solvers; print(*solvers.standard(), sep='\\n')",
    ]
    return subprocess.run(asked, capture_output=True, text=True, check=True).stdout.split()


def numbers(folder, jobs, standard):
    """Rows without their times, as text: what every method of the standard suite gives on three
    small cases."""
    specs = [word for s in standard for word in ("-s", s)]
    args = [
        "run",
        "tide",
        "sliding",
        "three_discs",
        *specs,
        "--h",
        "0.05,0.02",
        "--k",
        "1e3",
        "--tol",
        "1e-6",
        "-j",
        str(jobs),
    ]
    done = subprocess.run(
        [sys.executable, "-m", "nsbench", *args, "-o", str(folder)],
        capture_output=True,
        text=True,
        timeout=300,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return {
        key: {k: repr(v) for k, v in row.items() if k not in TIMES}
        for key, row in read_journal(folder).items()
    }


@pytest.mark.long
@pytest.mark.survives("same bytes")
def test_one_worker_and_two_give_the_same_numbers(tmp_path, standard):
    one, two = (numbers(tmp_path / name, jobs, standard) for name, jobs in (("one", 1), ("two", 2)))
    assert one == two
    made = {row["solver"] for row in one.values() if row["status"] != "'refused'"}
    assert made == {repr(s) for s in standard}


@pytest.mark.long
@pytest.mark.survives("zeno")
def test_a_scene_whose_events_accumulate_is_a_row_and_the_others_go_on(tmp_path, capsys):
    """x' = B sgn(x), a spiral that shrinks by a third in every turn; from (1, 0.3) it reaches the
    corner in finite time."""
    path = case_file(
        tmp_path,
        name="spiral",
        x0="[1.0, 0.3]",
        t="np.linspace(0, 3, 31)",
        drift="0.0 * x",
        problem=(
            "Filippov.relay(drift, -np.array([[1.0, -2.0], [2.0, 1.0]]) / 5**0.5, lambda xp: "
            "lambda t, x: x + 0.0)"
        ),
    )
    out = tmp_path / "r"
    assert (
        main(
            [
                "run",
                "sliding",
                "--cases",
                str(path),
                "-s",
                "event_driven",
                "--tol",
                "1e-6",
                "-j",
                "1",
                "-o",
                str(out),
            ]
        )
        == 0
    )
    found = {r["case"]: r for r in read_journal(out).values()}
    assert found.keys() == {"spiral", "sliding"} and found["sliding"]["status"] in (
        "ok",
        "below_reference",
    )
    assert found["spiral"]["status"] == "chatter" and "t = " in found["spiral"]["why"]
    assert (out / "report.html").exists()
