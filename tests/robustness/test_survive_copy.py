"""A copy of the package with files that are broken: what they are needed for is refused by name,
everything else runs."""

import os
import shutil
from pathlib import Path

import pytest
from command_server import Commands
from solver_file import solver

import nsbench
from nsbench.results.journal import read_journal

ROOT = Path(nsbench.__file__).parent.parent
BROKEN = {
    "missing": "import no_such_library",
    "raises": "raise RuntimeError('on purpose')",
    "half": "def (",
    "exits": "import sys; sys.exit(3)",
    "nothing": "x = 1",
}


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    folder = tmp_path_factory.mktemp("copy")
    skip = shutil.ignore_patterns("__pycache__", "discs*", "ep*")
    # compiled kernels come along: they are valid for files of the same content and time
    shutil.copytree(ROOT / "nsbench", folder / "nsbench", ignore=shutil.ignore_patterns("*.pyc"))
    shutil.copytree(
        ROOT / "cases", folder / "nsbench" / "cases", ignore=shutil.ignore_patterns("__pycache__")
    )
    shutil.copytree(
        ROOT / "reference_solutions", folder / "nsbench" / "reference_solutions", ignore=skip
    )
    return folder


@pytest.fixture(scope="module")
def run(copy):
    """`nsbench run`, of the copy, in a process of its own."""
    env = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | {"OMP_NUM_THREADS": "1"}
    with Commands(copy, env) as command:
        yield lambda *args: command("run", "-j", "1", *args)


@pytest.mark.long
@pytest.mark.survives("broken plugin")
def test_others_run_beside_plugins_that_do_not_load(copy, tmp_path, run):
    for name, text in BROKEN.items():
        for kind in ("cases", "solvers"):
            (copy / "nsbench" / kind / f"zz_{name}_{kind}.py").write_text(text)
    (copy / "nsbench" / "solvers" / "zz_own.py").write_text(solver("pass"))
    try:
        done = run(
            "tide",
            "apple",
            "-s",
            "pbd",
            "-s",
            "zz_own",
            "--h",
            "0.1",
            "-o",
            str(tmp_path / "r"),
        )
    finally:
        for kind in ("cases", "solvers"):
            for file in (copy / "nsbench" / kind).glob("zz_*"):
                file.unlink()
    assert done.returncode == 0, done.stderr
    found = {(r["case"], r["solver"]): r["status"] for r in read_journal(tmp_path / "r").values()}
    assert found.keys() == {(c, s) for c in ("apple", "tide") for s in ("pbd", "zz_own")}
    assert (
        set(found.values()) <= {"ok", "below_reference"}
        and (tmp_path / "r" / "report.html").exists()
    )


def cut(data):
    return data[: len(data) // 2]


@pytest.mark.long
@pytest.mark.survives("spoilt reference", "foreign reference")
@pytest.mark.parametrize(
    "name, change, said",
    [
        ("tide.npz", cut, "cannot be read"),
        ("tide.json", cut, "cannot be read"),
        ("tide.npz", lambda data: b"", "cannot be read"),
        (
            "tide.json",
            lambda data: data.replace(b'"state_error": ', b'"state_error": 1'),
            "does not match the checksum",
        ),
        ("sliding.npz", cut, "cannot be read"),
    ],
    ids=["arrays", "description", "empty", "edited", "no impulses in the closed form"],
)
def test_a_spoilt_reference_is_an_error_that_names_it_though_there_is_a_closed_form(
    copy, tmp_path, name, change, said, run
):
    file = copy / "nsbench" / "reference_solutions" / name
    out = tmp_path / "r"
    case = name.partition(".")[0]
    old = file.read_bytes()
    file.write_bytes(change(old))
    try:
        assert file.read_bytes() != old
        done = run(case, "-s", "euler", "-s", "pbd", "--h", "0.1", "-o", str(out))
        if name == "tide.npz" and change is cut:  # others are made
            args = ("apple", "-s", "pbd", "--h", "0.1", "-o", str(tmp_path / "other"))
            assert run(*args).returncode == 0
    finally:
        file.write_bytes(old)
    assert (
        done.returncode == 2
        and f"{case}.npz" in done.stderr
        and said in done.stderr
        and not out.exists()
    )


@pytest.mark.long
@pytest.mark.survives("foreign reference")
def test_a_case_that_was_edited_without_its_reference_is_an_error(copy, tmp_path, run):
    file = copy / "nsbench" / "cases" / "tide.py"
    old = file.read_text()
    assert "0.5" in old
    file.write_text(old.replace("0.5", "0.25"))
    try:
        done = run("tide", "-s", "pbd", "--h", "0.1", "-o", str(tmp_path / "r"))
    finally:
        file.write_text(old)
    assert done.returncode == 2 and "tide.npz" in done.stderr and "another version" in done.stderr
    assert not (tmp_path / "r").exists()
