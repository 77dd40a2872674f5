"""Where modules lie: in this package, in an installed library, or in somebody's own folder. Nothing
is imported."""

from __future__ import annotations

import functools
import importlib.util
import sys
import sysconfig
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = ROOT.name


@functools.cache
def package_folders() -> dict[str, Path]:
    """Folders of the package, by dotted name; cases and references may lie beside it."""
    out = {PACKAGE: ROOT}
    for name in ("cases", "reference_solutions"):
        spec = importlib.util.find_spec(f"{PACKAGE}.{name}")
        if spec is not None:
            out[f"{PACKAGE}.{name}"] = Path(next(iter(spec.submodule_search_locations))).resolve()
    return out


@functools.cache
def module_file(module: str) -> Path | None:
    """File of a module of this package."""
    home = max((h for h in package_folders() if f"{module}.".startswith(f"{h}.")), key=len)
    base = (
        package_folders()[home].joinpath(*module[len(home) :].strip(".").split("."))
        if module != home
        else package_folders()[home]
    )
    return next((p for p in (base / "__init__.py", base.with_suffix(".py")) if p.is_file()), None)


def plugin_files(kind: str) -> dict[str, str]:
    """Files of the package's own "solvers" or "cases" by name."""
    folder = ROOT / kind if kind == "solvers" else package_folders()[f"{PACKAGE}.cases"]
    found = {
        p.stem: str(p)
        for p in sorted(folder.glob("*.py"))
        if not p.name.startswith("_") and p.stem != "base"
    }
    return found | (
        {p.parent.name: str(p) for p in sorted(folder.glob("*/method.py"))}
        if kind == "solvers"
        else {}
    )


def inside(path: Path) -> bool:
    return any(path.is_relative_to(home) for home in package_folders().values())


def is_user_file(path) -> bool:
    """Is the file neither of this package nor of an installed library?"""
    return not inside(Path(path)) and not is_installed(Path(path))


def is_installed(path: Path) -> bool:
    return bool({"site-packages", "dist-packages"} & {*path.parts}) or any(
        path.is_relative_to(p) for p in _standard()
    )


@functools.cache
def _standard() -> tuple[str, ...]:
    return tuple({sysconfig.get_path("stdlib"), sysconfig.get_path("platstdlib")})


def local_module_files(folder: Path, module: str, name: str) -> set[tuple[str, str]]:
    """The module as a file in the folder, with the __init__ of the packages on the way; {} where
    there is none."""
    out = set()
    base = folder
    for word in filter(None, module.split(".")):
        base = base / word
        out |= {
            ("file", str(p)) for p in (base / "__init__.py", base.with_suffix(".py")) if p.is_file()
        }
    inner = base / name if name.isidentifier() else None
    if inner is not None and (out or not module):
        out |= {
            ("file", str(p))
            for p in (inner / "__init__.py", inner.with_suffix(".py"))
            if p.is_file()
        }
    if not out and base != folder and base.is_dir():  # a folder without __init__
        out = {("file", str(p)) for p in sorted(base.rglob("*.py"))}
    return out


def installed_or_local(module: str, name: str) -> set[tuple[str, str]]:
    """A module that Python would find: a library where it is installed, else files."""
    top = module.partition(".")[0]
    if top in sys.stdlib_module_names:
        return set()
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, ValueError, AttributeError):
        spec = None
    places = (
        [spec.origin]
        if spec is not None and spec.origin
        else list(getattr(spec, "submodule_search_locations", ()) or ())
    )
    if not places:
        return set()
    if is_installed(Path(places[0])):
        return {("library", top)}
    folder = (
        Path(places[0]).parent.parent
        if Path(places[0]).name == "__init__.py"
        else Path(places[0]).parent
    )
    return local_module_files(folder, module, name)


def named_file(word: str, folder: Path) -> set[tuple[str, str]]:
    """The file beside a foreign file that one of its strings names."""
    if not word or "\n" in word or "\0" in word or word in (".", ".."):
        return set()
    try:
        place = folder / word
        return {("file", str(place.resolve()))} if place.is_file() else set()
    except OSError:
        return set()
