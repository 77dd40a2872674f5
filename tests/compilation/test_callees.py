"""A compiled kernel on disk is not used again once a file of kernels has changed."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import nsbench
from nsbench.compilation import numba_cache

ROOT = Path(nsbench.__file__).parent
IMPORT = "from nsbench.compilation.decorators import njit\n"
CALLEE = f"{IMPORT}@njit(cache=True)\ndef added(x):\n    return x + {{}}\n"
CONSTANT = "SHIFT = {}\n"
CALLER = (
    f"{IMPORT}from nsbench.linalg.callee import added\n"
    "from nsbench.lcp.constant import SHIFT\n"
    "@njit(cache=True)\ndef twice(x):\n    return 2.0 * added(x) + SHIFT\n"
)
CODE = (
    "from nsbench.qp.kernels.caller import twice; x = twice(1.0); "
    "print(x, sum(twice.stats.cache_hits.values()), sum(twice.stats.cache_misses.values()))"
)
# configures numba; a program of JAX whose one kernel takes arrays alone
NOT_IN_KERNELS = ("compilation/numba_cache.py", "dynamics/contacts/constraint_set.py")


@pytest.mark.long
def test_an_edit_of_a_callee_compiles_its_callers_anew(tmp_path):
    """Of a kernel that it calls, and of a constant that is part of its code, each in a file of
    another folder."""
    shutil.copytree(
        ROOT,
        tmp_path / "nsbench",
        ignore=shutil.ignore_patterns("__pycache__", "report", "gate", "reference"),
    )
    package = tmp_path / "nsbench"
    (package / "qp" / "kernels" / "caller.py").write_text(CALLER)
    env = {k: v for k, v in os.environ.items() if k != "NUMBA_DISABLE_JIT"} | {
        "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
        "PYTHONPATH": str(tmp_path),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    printed = []
    for number, shift in (("1.0", "0.0"), ("1.0", "0.0"), ("2.5", "0.0"), ("2.5", "9.0")):
        (package / "linalg" / "callee.py").write_text(CALLEE.format(number))
        (package / "lcp" / "constant.py").write_text(CONSTANT.format(shift))
        done = subprocess.run(
            [sys.executable, "-c", CODE], capture_output=True, text=True, env=env, cwd=tmp_path
        )
        assert done.returncode == 0, done.stderr
        printed.append(done.stdout.split())
    assert printed == [
        ["4.0", "0", "1"],
        ["4.0", "1", "0"],
        ["7.0", "0", "1"],
        ["16.0", "0", "1"],
    ]


def test_kernels_depend_on_files_of_kernels_alone():
    """What numba's stamp of a kernel holds is all that its code can be made of."""
    files = {*numba_cache.kernel_files()}
    assert len(files) > 50
    for file in files:
        found = re.findall(
            r"^from (nsbench[\w.]*) import (\([^)]*\)|[^\n]*)", file.read_text(), re.M
        )
        for module, names in found:
            for name in ("", *re.findall(r"\w+", names)):
                place = ROOT.parent / (f"{module}.{name}".strip(".").replace(".", "/") + ".py")
                if place.is_file() and place.relative_to(ROOT).as_posix() not in NOT_IN_KERNELS:
                    assert place in files, f"{file} imports {place}"


def test_every_kernel_takes_its_decorator_from_the_module_that_configures_numba():
    for file in ROOT.rglob("*.py"):
        if file.parent.name != "compilation":
            taken = re.findall(r"^from numba import ([^\n]*)", file.read_text(), re.M)
            assert not {"njit", "jit", "cfunc", "vectorize"} & {*re.findall(r"\w+", str(taken))}, (
                file
            )
            assert "numba.njit(" not in file.read_text() or file.name == "namespace_checks.py", file


def test_every_kernel_is_stored_on_disk():
    """One that is not compiles in every process."""
    for path in numba_cache.kernel_files():
        text = path.read_text(encoding="utf-8")
        uses = re.sub(r"^(from|import) .*$", "", text, flags=re.M)
        if path.name != "decorators.py":
            assert not re.findall(r"\bnjit\b(?!\(\s*cache=True)", uses), path
