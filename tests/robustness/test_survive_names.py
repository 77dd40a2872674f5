"""Names that are taken, misspelled, or would command a terminal are an error that quotes them."""

import re

import pytest
from still_solver import solver
from survive_files import case_file

import nsbench
from nsbench.cli import main


@pytest.mark.survives("same name")
@pytest.mark.parametrize("second", ["scene", "SCENE"])
def test_two_case_files_of_one_name_are_an_error_with_both_files(tmp_path, capsys, second):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
    one = case_file(tmp_path / "a")
    other = case_file(tmp_path / "b", name=second)
    assert (
        main(
            [
                "run",
                "--cases",
                str(one),
                "--cases",
                str(other),
                "-s",
                "pbd",
                "-o",
                str(tmp_path / "r"),
            ]
        )
        == 2
    )
    said = capsys.readouterr().err
    assert str(one) in said and str(other) in said and not (tmp_path / "r").exists()
    with pytest.raises(ValueError, match="alike"):
        nsbench.run([nsbench.load_case(one), nsbench.load_case(one)], "pbd", h=0.1)


@pytest.mark.survives("same name")
@pytest.mark.parametrize(
    "first, second", [("twin", "twin"), ("twin", "Twin"), (None, "pbd"), (None, "PBD")]
)
def test_two_solver_files_of_one_name_are_an_error_with_both_files(tmp_path, capsys, first, second):
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
    files = [solver(tmp_path / "a", first)] if first else []
    files += [solver(tmp_path / "b", second)]
    args = [a for f in files for a in ("--solvers", str(f))]
    assert main(["run", "tide", *args, "-o", str(tmp_path / "r")]) == 2
    said = capsys.readouterr().err
    assert str(files[-1]) in said and (str(files[0]) if first else "solvers/pbd/method.py") in said


NASTY = [
    "<script>alert(1)</script>",
    "=cmd()",
    "\x1b[31mred",
    "../../etc/passwd",
    "a\nb",
    "x" * 300,
    "",
    "a b",
    "é",
]


@pytest.mark.survives("names")
@pytest.mark.parametrize("name", NASTY)
def test_a_case_is_not_named_like_that(tmp_path, capsys, name):
    path = tmp_path / "c.py"
    path.write_text(case_file(tmp_path, name="plain").read_text().replace("'plain'", repr(name)))
    assert main(["run", "--cases", str(path), "-s", "pbd", "-o", str(tmp_path / "r")]) == 2
    said = capsys.readouterr().err
    assert repr(name)[:60].rstrip("'") in said.replace("\\\\", "\\") and len(said) < 1000
    assert not re.search(r"[\x00-\x09\x0b-\x1f]", said) and said.count("\n") == 1


@pytest.mark.survives("names")
@pytest.mark.parametrize("name", [n for n in NASTY if "/" not in n and n and len(n) < 200])
def test_a_solver_file_is_not_named_like_that(tmp_path, capsys, name):
    path = solver(tmp_path, name)
    for args in (
        ["run", "tide", "--solvers", str(path), "-o", str(tmp_path / "r")],
        ["run", "tide", "-s", name],
    ):
        assert main(args) == 2
        said = capsys.readouterr().err
        assert not re.search(r"[\x00-\x09\x0b-\x1f]", said) and said.count("\n") == 1


@pytest.mark.survives("names")
def test_what_a_run_says_cannot_command_a_terminal(tmp_path, capsys):
    path = case_file(tmp_path)
    path.write_text(
        path.read_text() + "\nraise ValueError('\\x1b]0;owned\\x07 \\x9b31m \\u202e')\n"
    )
    assert main(["run", "--cases", str(path)]) == 2
    said = capsys.readouterr().err
    assert "owned" in said and not re.search(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202e]", said)


@pytest.mark.survives("nearest name")
@pytest.mark.parametrize(
    "args, said",
    [
        (["run", "three_disc"], "'three_discs'"),
        (["run", "discs[sed=3]"], "'seed'"),
        (["run", "tide", "-s", "catchingup"], "'catching_up'"),
        (["run", "tide", "-s", "pbd[sweps=2]"], "'sweeps'"),
        (["run", "tide", "-s", "catching_up[backend=osqq]"], "'osqp'"),
        (["reference", "verify", "three_disks"], "'three_discs'"),
        (["show", "tied"], "'tide'"),
    ],
)
def test_unknown_names_come_with_the_nearest(args, said, capsys):
    assert main(args) == 2
    assert f"did you mean {said}" in capsys.readouterr().err


@pytest.mark.survives("nothing matches")
@pytest.mark.parametrize(
    "args",
    [["--tag", "no-such-tag"], ["tide", "--tag", "zeno"], ["--suite", "smoke", "--tag", "zeno"]],
)
def test_a_filter_that_leaves_nothing_is_an_error(args, capsys):
    assert main(["run", *args]) == 2
    assert "no case matches" in capsys.readouterr().err
