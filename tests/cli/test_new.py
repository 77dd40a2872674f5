"""`nsbench new` writes files that pass `nsbench check`, and never over another."""

import pytest

from nsbench import solvers
from nsbench.case import get_case
from nsbench.cli import main
from nsbench.cli.new import TEMPLATES

KINDS = sorted(tuple(p.stem.split("_")) for p in TEMPLATES.glob("*.txt"))


@pytest.mark.long
@pytest.mark.parametrize("what, kind", KINDS)
def test_what_is_written_passes_the_check(what, kind, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["new", what, f"my_{kind}", "--kind", kind]) == 0
    assert main(["check", f"my_{kind}.py"]) == 0, capsys.readouterr().out
    assert f"my_{kind}.py: fine" in capsys.readouterr().out
    assert "NAME" not in (tmp_path / f"my_{kind}.py").read_text()


@pytest.mark.parametrize("kind, case", [("contact", "tide"), ("switch", "slide_exit")])
def test_a_method_that_is_written_takes_steps_longer_than_a_spacing(
    kind, case, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "method", f"long_{kind}", "--kind", kind]) == 0
    assert f"nsbench run {case} --solvers" in capsys.readouterr().out
    name = solvers.load(f"long_{kind}.py")
    case = get_case(case)
    assert not solvers.get(name).refuses(case)
    traj = solvers.solve(case, name, h=2.5 * float(case.t[1] - case.t[0]))
    assert traj.status.ok and len(traj.x) == len(case.t)


def test_a_file_that_is_there_stays(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text("x = 1\n")
    assert main(["new", "case", "mine"]) == 2
    assert (tmp_path / "mine.py").read_text() == "x = 1\n"
    assert main(["new", "case", "other", "--kind", "disc"]) == 2
    assert "did you mean 'discs'" in capsys.readouterr().err
    assert main(["new", "method", "a b"]) == 2
