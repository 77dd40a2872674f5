"""Find the cases that a user names: NAME, NAME[p=v], PATH.py, PATH.py[p=v], or a folder of files.

A case without parameters that lists SUITES stands for the parameter sets of the suite.
"""

from __future__ import annotations

import re
from pathlib import Path
from types import ModuleType

from nsbench.case.definition import Case
from nsbench.case.registry import (
    case_names,
    get_case,
    load_case,
    load_module,
    plugin_case_file,
)
from nsbench.case.spec import parse_spec

SUITES = ("smoke", "standard", "hard", "full")


def split_path(name: str) -> tuple[str, dict] | None:
    """Return path and parameters of a name that means a file or folder; None for a plain name."""
    m = re.fullmatch(r"(.*?\.py|.*?)\s*(\[[^\[\]]*\])?\s*", name, re.S)
    path, inner = m.groups() if m else (name, None)
    if path.endswith(".py"):
        return path, parse_spec(f"case{inner or ''}")[1]
    is_folder = inner is None and Path(path).is_dir() and path not in case_names()
    return (path, {}) if is_folder else None


def python_files(path: str | Path) -> list[Path]:
    """List the Python file at a path, or those in a folder that do not start with "_" or ".".

    Raises FileNotFoundError if there is none.
    """
    path = Path(path)
    if path.is_dir():
        files = sorted(p for p in path.glob("*.py") if not p.name.startswith(("_", ".")))
        if not files:
            raise FileNotFoundError(f"no case or solver file in {path}")
        return files
    if not path.is_file():
        raise FileNotFoundError(f"no file {path}")
    return [path]


def suite_parameters(module: ModuleType, suite: str) -> list[dict]:
    """Return the parameter sets of a suite; a module without SUITES has one, in all suites.

    "full" holds those of "standard" and "hard" too; where a user's file lists none for the suite,
    those of "standard" stand for it. Raises ValueError if SUITES is not as it must be.
    """
    suites = getattr(module, "SUITES", {"standard": [{}]})
    if not isinstance(suites, dict) or not set(suites) <= set(SUITES):
        raise ValueError(
            f"SUITES of {module.__file__} is {suites!r:.80}; a dict from {', '.join(SUITES)} to "
            "lists of parameters is needed, such as {'standard': [{}, {'mu': 0.1}]}"
        )
    for sets in suites.values():
        if not isinstance(sets, (list, tuple)) or not all(isinstance(p, dict) for p in sets):
            raise ValueError(
                f"SUITES of {module.__file__} has the entry {sets!r:.80}; a list of dicts of "
                "parameters is needed"
            )
    if suite == "full":
        sets = [*suites.get("standard", []), *suites.get("hard", []), *suites.get("full", [])]
        return sets or [{}]
    return suites.get(suite) or suites.get("standard") or [{}]


def cases_of(name: str, suite: str = "standard") -> list[tuple[Case, str]]:
    """Build the cases that a name stands for, each with its file ("": a registered case).

    Raises LookupError, ValueError or FileNotFoundError with a sentence.
    """
    found = split_path(name)
    if found is None:
        base, params = parse_spec(name)
        brought = plugin_case_file(base)
        return [(load_case(brought, **params), brought) if brought else (get_case(name), "")]
    path, params = found
    out = []
    for file in python_files(path):
        if Path(path).is_dir() and not _defines_case(file):
            continue
        sets = [params] if params else suite_parameters(load_module(file), suite)
        out += [(load_case(file, **p), str(file)) for p in sets]
    if not out:
        raise FileNotFoundError(f"no case file in {path}: none defines CASE or make(**params)")
    return out


def _defines_case(file: Path) -> bool:
    """Does a file of a folder define a case? One that fails to load is reported when it is."""
    module = load_module(file)
    return hasattr(module, "CASE") or hasattr(module, "make")
