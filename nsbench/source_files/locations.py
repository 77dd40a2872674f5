"""Where a file lies: in this package, in an installed library, or with the user.

No module is imported to answer.
"""

from __future__ import annotations

import functools
import importlib.util
import sysconfig
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT.name
CASES = f"{PACKAGE}.cases"
REFERENCES = f"{PACKAGE}.reference_solutions"


@functools.cache
def package_folders() -> dict[str, Path]:
    """Return the folders of the package by dotted name; cases and references may lie beside it."""
    folders = {PACKAGE: ROOT}
    for name in (CASES, REFERENCES):
        spec = importlib.util.find_spec(name)
        if spec is not None:
            folders[name] = Path(next(iter(spec.submodule_search_locations))).resolve()
    return folders


@functools.cache
def case_files() -> dict[str, str]:
    """Return the case files of the catalogue by name."""
    folder = package_folders()[CASES]
    return {p.stem: str(p) for p in sorted(folder.glob("*.py")) if not p.name.startswith("_")}


def is_in_catalogue(path: Path) -> bool:
    """Is the file a case of the catalogue?"""
    return path.is_relative_to(package_folders()[CASES])


def is_in_package(path: Path) -> bool:
    """Is the file one of this package, its cases and stored references included?"""
    return any(path.is_relative_to(folder) for folder in package_folders().values())


@functools.lru_cache(maxsize=4096)
def is_user_file(path: str | Path) -> bool:
    """Is the file neither of this package nor of an installed library?"""
    return not is_in_package(Path(path)) and not is_installed(Path(path))


def is_installed(path: Path) -> bool:
    """Is the file one of an installed library, or of Python's own?"""
    return bool({"site-packages", "dist-packages"} & {*path.parts}) or any(
        path.is_relative_to(folder) for folder in _standard_library()
    )


@functools.cache
def _standard_library() -> tuple[str, ...]:
    return tuple({sysconfig.get_path("stdlib"), sysconfig.get_path("platstdlib")})
