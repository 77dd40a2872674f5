"""A wheel holds every file that the package is made of: code, cases, references, templates."""

import shutil
import subprocess
import sys
import zipfile
from importlib import metadata
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PARTS = ("nsbench", "cases", "reference_solutions")
BUILD = "import sys; from setuptools import build_meta as b; print(b.build_wheel(sys.argv[1]))"


def test_a_wheel_holds_the_whole_package(tmp_path):
    try:
        version = int(metadata.version("setuptools").split(".")[0])
    except metadata.PackageNotFoundError:
        version = 0
    if version < 68:
        pytest.skip("needs setuptools 68 or newer, which builds the wheel")
    checkout = tmp_path / "checkout"
    for part in PARTS:
        shutil.copytree(
            ROOT / part, checkout / part, ignore=shutil.ignore_patterns("__pycache__", "*.nb[ci]")
        )
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, checkout)
    command = [sys.executable, "-c", BUILD, str(tmp_path)]
    subprocess.run(command, cwd=checkout, check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    held = set(zipfile.ZipFile(wheel).namelist())
    for part in PARTS:
        for path in (ROOT / part).rglob("*"):
            name = path.relative_to(ROOT).as_posix()
            if path.is_file() and "__pycache__" not in name:
                assert (name if part == "nsbench" else f"nsbench/{name}") in held


def test_the_package_is_marked_as_typed():
    assert (ROOT / "nsbench" / "py.typed").is_file()
