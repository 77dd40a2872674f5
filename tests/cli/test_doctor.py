"""The doctor finds what is wrong with an installation, says it in a sentence, and its exit code
tells."""

from importlib import metadata

import pytest

from nsbench import solvers
from nsbench.cli import doctor, main


def test_a_sound_installation_has_no_fault(capsys):
    assert main(["doctor"]) == 0
    said = capsys.readouterr().out
    assert (
        "nothing stands in the way" in said
        and "stored references are whole" in said
        and "pbd on tide: ok" in said
    )


@pytest.mark.parametrize(
    "wanted, said", [("numpy>=99", ">=99 is needed"), ("no-such-library>=1", "is not installed")]
)
def test_a_library_that_is_missing_or_too_old_is_a_fault(monkeypatch, wanted, said):
    monkeypatch.setattr(metadata, "requires", lambda name: [wanted, 'other>=1; extra == "test"'])
    verdict, sentence = next(doctor._check_libraries())
    assert verdict == doctor.FAULT and said in sentence


def test_a_plugin_that_does_not_load_and_a_wrong_solution_are_faults(monkeypatch, capsys):
    monkeypatch.setattr(solvers, "broken", lambda: {"mine": "ImportError: no module"})
    solve = solvers.solve
    monkeypatch.setattr(
        solvers,
        "solve",
        lambda case, spec, **kw: solve(case, spec, **({"h": 0.05} if "h" in kw else kw)),
    )
    found = [*doctor._check_plugins(), *doctor._check_solutions()]
    assert [v for v, _ in found] == [doctor.FAULT, doctor.FAULT, doctor.FINE]
    monkeypatch.setattr(doctor, "examine", lambda: found)
    assert main(["doctor"]) == 5 and "2 fault(s)" in capsys.readouterr().out


def test_a_folder_that_cannot_be_written_is_a_warning(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file" / "below"))
    verdict, sentence = next(doctor._check_folders())
    assert verdict == doctor.WARNING and "compiled kernels" in sentence
