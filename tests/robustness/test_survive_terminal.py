"""Neither language, line ends, letters nor the terminal change what is computed or break what is
said."""

import csv
import locale
import os
import subprocess
import sys

import pytest
from survive_files import case_file

import nsbench
from nsbench import columns
from nsbench.cli import main
from nsbench.execute.progress import Progress
from nsbench.gate import baseline
from nsbench.report.data import read
from nsbench.study import Spec

TIMES = {*columns.names("clock")}


def command(*args, folder, **env):
    """The command in a process of its own, without a terminal; numbers of its rows where it ran
    any."""
    keep = {
        k: os.environ[k]
        for k in ("PATH", "HOME", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "PYTHONPATH")
        if k in os.environ
    }
    done = subprocess.run(
        [sys.executable, "-m", "nsbench", *map(str, args)],
        cwd=folder,
        env=keep | env,
        timeout=300,
        stdin=subprocess.DEVNULL,
        capture_output=True,
    )
    return done.returncode, done.stdout, done.stderr


def numbers(folder):
    with open(folder / "runs.csv", newline="", encoding="utf-8") as file:
        return [{k: v for k, v in r.items() if k not in TIMES} for r in csv.DictReader(file)]


@pytest.fixture(scope="module")
def comma(tmp_path_factory):
    """A locale with decimal commas, made here where the machine has the means and none is
    installed."""
    folder = tmp_path_factory.mktemp("locale")
    for name in ("de_DE.UTF-8", "de_DE.utf8", "fr_FR.UTF-8"):
        try:
            before = locale.setlocale(locale.LC_NUMERIC)
            locale.setlocale(locale.LC_NUMERIC, name)
            locale.setlocale(locale.LC_NUMERIC, before)
            return {"LC_ALL": name}
        except locale.Error:
            continue
    try:
        made = subprocess.run(
            ["localedef", "-i", "de_DE", "-f", "UTF-8", str(folder / "de_DE.UTF-8")],
            capture_output=True,
        )
    except FileNotFoundError:
        made = None
    if made is None or not (folder / "de_DE.UTF-8").exists():
        pytest.skip("no locale with decimal commas, and no means to make one")
    return {"LC_ALL": "de_DE.UTF-8", "LOCPATH": str(folder)}


COMMA = """
import locale
locale.setlocale(locale.LC_ALL, "")
if locale.localeconv()["decimal_point"] != ",":
    raise ValueError("no decimal comma here")
"""


@pytest.mark.long
@pytest.mark.survives("locale")
def test_decimal_commas_change_no_number(tmp_path, comma):
    """In a process that has set the locale: the case file does it."""
    path = case_file(tmp_path)
    args = ("run", "--cases", path, "-s", "pbd", "-s", "catching_up", "--h", "0.1,0.05", "-j", "1")
    code, out, err = command(*args, "-o", "plain", folder=tmp_path)
    assert code == 0, out + err
    path.write_text(path.read_text() + COMMA)
    code, out, err = command(*args, "-o", "comma", folder=tmp_path, **comma)
    assert code == 0, out + err
    assert numbers(tmp_path / "comma") == numbers(tmp_path / "plain") != []


@pytest.mark.long
@pytest.mark.survives("locale", "terminal")
@pytest.mark.parametrize(
    "env",
    [
        {"LANG": "C", "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
        {"PYTHONIOENCODING": "ascii"},
        {"LANG": "C", "NO_COLOR": "1", "COLUMNS": "20", "TERM": "dumb"},
    ],
    ids=["C", "ascii", "dumb"],
)
def test_a_plain_terminal_is_enough(tmp_path, env):
    """Letters that it lacks are shown by their number; no colours, no display."""
    folder = tmp_path / "Bücher é"
    folder.mkdir()
    path = case_file(folder, more="doc='Höhe über dem Boden → ∞'")
    path.write_text(
        path.read_text().replace('"""A scene', '"""Szene → ∞. A scene'), encoding="utf-8"
    )
    args = ("run", "--cases", path, "-s", "pbd", "--h", "0.1", "-j", "1", "-o", folder / "r")
    code, out, err = command(*args, folder=tmp_path, **env)
    assert code == 0, out + err
    assert b"\x1b" not in out + err and b"\r" not in out and len(numbers(folder / "r")) == 1
    assert "über dem Boden → ∞" in (folder / "r" / "report.html").read_text(encoding="utf-8")
    code, out, err = command("show", path, folder=tmp_path, **env)
    assert code == 0, out + err
    if env.get("PYTHONIOENCODING") == "ascii":
        assert b"\\u2192" in out


@pytest.mark.survives("locale")
def test_line_ends_of_windows_change_no_number(tmp_path):
    from nsbench.study.describe import describe_case

    path = case_file(tmp_path)
    one = nsbench.load_case(path)
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    other = nsbench.load_case(path)
    a = nsbench.solve(one, "pbd", h=0.1)
    b = nsbench.solve(other, "pbd", h=0.1)
    assert (
        a.x.tobytes() == b.x.tobytes()
        and describe_case(one)["digest"] == describe_case(other)["digest"]
    )
    lines = ",".join(baseline.COLUMNS) + "\ntide,pbd,h=1,state_sup,near,0.5,0.1,0,,c=1,why\n"
    for end in ("\n", "\r\n"):
        (tmp_path / "b.csv").write_bytes(lines.replace("\n", end).encode())
        assert [x.value for x in baseline.read(tmp_path / "b.csv").values()] == [0.5]


@pytest.mark.survives("terminal")
@pytest.mark.parametrize("width", [1, 5, 20, 80, 200])
def test_a_line_of_progress_fits_the_terminal(width):
    said = []
    spec = Spec("discs[n=1000,seed=0]", "catching_up[backend=osqp]", "h", 0.001)
    bar = Progress([spec] * 300, 1, lambda text, end="\n": said.append(text), True)
    for k in range(300):
        bar.step(spec, {"status": "ok" if k % 7 else "timeout", "seconds": 0.1})
        bar.printed_at = 0.0
        assert len(bar.line("discs[n=1000,seed=0] pbd h=0.001", width)) == width
    assert said and all(len(s.lstrip("\r")) < 200 for s in said)


@pytest.mark.survives("all fail")
def test_a_study_in_which_everything_fails_has_exit_code_3_and_a_report(tmp_path, capsys, runs_here):
    path = case_file(tmp_path, "xp.nan * x")
    args = ["run", "--cases", str(path), "-s", "pbd", "-s", "catching_up", "--h", "0.1", "-j", "1"]
    assert main([*args, "-o", str(tmp_path / "r")]) == 3
    assert "2 of 2 runs failed" in capsys.readouterr().out
    page = (tmp_path / "r" / "report.html").read_text(encoding="utf-8")
    assert "No run gave a number" in page and "stopped being finite" in page
    assert [set(r.col["status"]) for r in read(tmp_path / "r").runs.values()] == [{"nan"}, {"nan"}]


@pytest.mark.survives("all fail")
def test_one_failure_among_others_is_a_row_among_others(tmp_path, runs_here):
    (tmp_path / "c").mkdir()
    case_file(tmp_path / "c", "xp.nan * x", name="bad")
    case_file(tmp_path / "c", name="good")
    code = main(
        [
            "run",
            "--cases",
            str(tmp_path / "c"),
            "-s",
            "pbd",
            "--h",
            "0.1,0.05",
            "-j",
            "1",
            "-o",
            str(tmp_path / "r"),
        ]
    )
    found = {case: set(r.col["status"]) for (case, _), r in read(tmp_path / "r").runs.items()}
    assert code == 0 and found == {"bad": {"nan"}, "good": {"ok"}}
