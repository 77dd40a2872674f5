"""A compiled kernel on disk is not used again once a file that it imports has changed."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import nsbench

ROOT = Path(nsbench.__file__).parent
CALLEE = "from numba import njit\n@njit(cache=True)\ndef added(x):\n    return x + {}\n"
CALLER = (
    "from numba import njit\nfrom nsbench.compilation.numba_setup.callee import added\n"
    "@njit(cache=True)\ndef twice(x):\n    return 2.0 * added(x)\n"
)
CODE = (
    "from nsbench.compilation.numba_setup.caller import twice; x = twice(1.0); "
    "print(x, sum(twice.stats.cache_hits.values()), sum(twice.stats.cache_misses.values()))"
)


def test_an_edit_of_a_callee_compiles_its_callers_anew(tmp_path):
    shutil.copytree(
        ROOT,
        tmp_path / "nsbench",
        ignore=shutil.ignore_patterns("__pycache__", "report", "gate", "reference"),
    )
    kernels = tmp_path / "nsbench" / "kernels"
    (kernels / "caller.py").write_text(CALLER)
    env = {k: v for k, v in os.environ.items() if k != "NUMBA_DISABLE_JIT"} | {
        "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
        "PYTHONPATH": str(tmp_path),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    said = []
    for number in ("1.0", "1.0", "2.5"):
        (kernels / "callee.py").write_text(CALLEE.format(number))
        done = subprocess.run(
            [sys.executable, "-c", CODE], capture_output=True, text=True, env=env, cwd=tmp_path
        )
        assert done.returncode == 0, done.stderr
        said.append(done.stdout.split())
    assert said == [["4.0", "0", "1"], ["4.0", "1", "0"], ["7.0", "0", "1"]]
