"""The doctor finds what is wrong with an installation, says it in a sentence, and its exit code
tells."""

import os
import subprocess
import sys
from importlib import metadata

import pytest
from numba.core.caching import _CacheLocator

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


def damaged(folder):
    """One file of every kind that nobody can use."""
    folder.mkdir(parents=True)
    (folder / "a.nbi").write_bytes(b"")
    (folder / "a.1.nbc").write_bytes(b"\x80\x04garbage")
    (folder / "b.nbi").mkdir()
    (folder / "c.nbi").symlink_to("nowhere")
    os.mkfifo(folder / "d.nbi")
    return 5


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no FIFOs here")
def test_a_damaged_cache_is_a_warning_of_one_line_for_each_file(monkeypatch, tmp_path, capsys):
    from numba import config

    from nsbench.source_files.kernel_files import kernel_files

    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "kernels"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    place = _CacheLocator.get_suitable_cache_subpath(str(kernel_files()[0]))
    count = damaged(tmp_path / "kernels" / place)
    (tmp_path / "nsbench" / "pointers").mkdir(parents=True)
    (tmp_path / "nsbench" / "pointers" / "x.bin").write_bytes(b"garbage")
    (tmp_path / "nsbench" / "programs").write_text("a file in place of a folder")
    found = [*doctor._check_caches()]
    warnings = [sentence for verdict, sentence in found if verdict == doctor.WARNING]
    assert len(warnings) == count + 1 and all("compiled again" in w for w in warnings)
    for name in ("a.nbi", "a.1.nbc", "b.nbi", "c.nbi", "d.nbi", "x.bin"):
        assert sum(f"{name} " in w for w in warnings) == 1


def test_whatever_a_check_comes_across_is_a_fault_of_one_line(monkeypatch, capsys):
    def _check_folders():
        yield doctor.FINE, "one"
        raise PermissionError(13, "Permission denied\nand more", "/somewhere")

    monkeypatch.setattr(doctor, "_check_folders", _check_folders)
    monkeypatch.setattr(doctor, "_check_solutions", lambda: iter([(doctor.FINE, "last")]))
    assert main(["doctor"]) == 5
    lines = capsys.readouterr().out.splitlines()
    assert sum("folders cannot be examined: PermissionError" in line for line in lines) == 1
    assert any("last" in line for line in lines) and lines[-1].startswith("1 fault(s)")


@pytest.mark.long
def test_a_damaged_kernel_of_this_package_is_found_and_mended(tmp_path):
    """In processes of their own: one stores it, one finds it damaged, one compiles it again."""
    env = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "k"), "XDG_CACHE_HOME": str(tmp_path)}
    use = (
        "import numpy as np; from nsbench.compilation.decorators import python_entry;"
        "from nsbench.linalg.max_norm import largest; print(python_entry(largest)(np.ones(2)))"
    )
    examine = "from nsbench.cli import doctor; print([*doctor._check_caches()])"
    (tmp_path / "here").mkdir()

    def said(code):
        done = subprocess.run(
            [sys.executable, "-c", code],
            env=env,
            capture_output=True,
            text=True,
            cwd=tmp_path / "here",
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    value = said(use)
    for kind in ("nbi", "nbc"):
        (path,) = (tmp_path / "k").rglob(f"*.{kind}")
        path.write_bytes(path.read_bytes()[:-7])
        assert f"{path.name} is not as its checksum says" in said(examine)
        assert said(use) == value
        assert "compiled again" not in said(examine)
