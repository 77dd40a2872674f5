"""Machine code that others could have written is not run: kernels are kept where nobody else
writes."""

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

import nsbench
from nsbench.compilation.numba_cache import has_private_files

CODE = """
import numba, nsbench.linalg.max_norm as d, numpy as np
d.largest.py_func
print(d.largest._cache.cache_path)
"""


@pytest.mark.survives("no pickle")
@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no owners of files here")
def test_kernels_move_where_others_could_replace_them(tmp_path):
    """A copy of the package in a folder that everybody can write to."""
    home = Path(nsbench.__file__).parent
    shutil.copytree(home, tmp_path / "nsbench", ignore=shutil.ignore_patterns("__pycache__"))
    env = os.environ | {
        "PYTHONPATH": str(tmp_path),
        "XDG_CACHE_HOME": str(tmp_path / "own"),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    env.pop("NUMBA_CACHE_DIR", None)
    place = lambda: Path(
        subprocess.run(
            [sys.executable, "-c", CODE],
            env=env,
            cwd=tmp_path,
            check=True,
            capture_output=True,
            text=True,
        ).stdout.strip()
    )
    kernels = tmp_path / "nsbench" / "linalg"
    kernels.chmod(0o755)
    assert place() == kernels / "__pycache__"
    (kernels / "__pycache__").mkdir(exist_ok=True)
    (kernels / "__pycache__").chmod(0o777)
    moved = place()
    assert moved.is_relative_to(tmp_path / "own" / "nsbench" / "kernels")
    assert stat.S_IMODE((tmp_path / "own" / "nsbench" / "kernels").stat().st_mode) == 0o700


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no owners of files here")
@pytest.mark.parametrize(
    "mode, good", [(0o700, True), (0o755, True), (0o775, False), (0o777, False), (0o722, False)]
)
def test_who_can_write_to_a_folder(tmp_path, mode, good):
    (tmp_path / "f").mkdir()
    (tmp_path / "f").chmod(mode)
    assert (
        has_private_files(tmp_path / "f")
        == has_private_files(tmp_path / "f" / "not" / "yet")
        == good
    )
