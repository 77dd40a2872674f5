"""Dependencies of a user's case or solver file, found in its syntax tree without running it.

They are every import in it, at the top or inside functions, and so on through the user's own
modules.

Nothing is imported. An import leads to a module beside the file, to one elsewhere that Python would
find, or to an installed library, which counts by its version. Beyond imports count

    files beside the file that one of its strings names,
    its whole folder, where it imports by names that it computes,
    cases of the catalogue that it gets by name (all of them, where its strings name none).

The code of this package is not followed: a run key holds one digest of it (`package`).
`modulefinder` of the standard library is not used: it follows installed libraries as well, and
misses files that are found by a string.
"""

from __future__ import annotations

import ast
import functools
import importlib.util
import sys
from dataclasses import dataclass
from pathlib import Path

from nsbench.source_files import file_state, locations
from nsbench.source_files.locations import CASES, PACKAGE

GETS_A_CASE = ("get_case", "case_module", "case_names", "load_case")
IMPORTS_BY_NAME = ("import_module", "__import__")
RUNS_OTHER_CODE = ("spec_from_file_location", "run_path", "run_module", "exec", "eval")
LONGEST_NAME = 300  # characters of a string that may name a file or a case


@dataclass(frozen=True)
class Dependencies:
    """files: paths of all files, the first ones included; libraries: top-level names of the
    installed libraries that they import."""

    files: frozenset[str]
    libraries: frozenset[str]


@dataclass(frozen=True)
class _Source:
    """What one file says: imports as (module, name), with the name "" for the module itself;
    strings; does it import by names that it computes; does it get cases of the catalogue?"""

    imports: tuple[tuple[str, str], ...] = ()
    strings: frozenset[str] = frozenset()
    computes_imports: bool = False
    gets_cases: bool = False


def dependencies(*paths: str | Path) -> Dependencies:
    """Return everything that the files depend on, themselves included, but for the package."""
    to_visit = [str(Path(p).resolve()) for p in paths]
    files: set[str] = set()
    libraries: set[str] = set()
    while to_visit:
        path = to_visit.pop()
        if path not in files:
            files.add(path)
            more_files, more_libraries = _direct(path)
            to_visit += more_files
            libraries |= more_libraries
    return Dependencies(frozenset(files), frozenset(libraries))


@functools.cache
def _direct(path: str) -> tuple[frozenset[str], frozenset[str]]:
    """Return the files and the libraries that one file needs itself."""
    place = Path(path)
    if place.suffix != ".py" or (
        locations.is_in_package(place) and not locations.is_in_catalogue(place)
    ):
        return frozenset(), frozenset()
    source = _parsed(_text(path))
    files: set[str] = set()
    libraries: set[str] = set()
    for module, name in source.imports:
        found, library = _find(module, name, place)
        files |= found
        libraries |= library
    if source.gets_cases:
        files |= _catalogue_cases(source.strings)
    if locations.is_user_file(path):
        files |= {f for s in source.strings for f in _named_file(s, place.parent)}
        if source.computes_imports:
            files |= {str(p) for p in place.parent.glob("*.py")}
    return frozenset(files), frozenset(libraries)


@functools.cache
def _text(path: str) -> str:
    file_state.record_state(path)
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""


@functools.cache
def _parsed(text: str) -> _Source:
    """Read a file by its syntax tree; one that cannot be parsed imports nothing."""
    try:
        nodes = list(ast.walk(ast.parse(text)))
    except (SyntaxError, ValueError):
        return _Source()
    imports: list[tuple[str, str]] = []
    words: list[str] = []
    for node in nodes:
        if isinstance(node, ast.ImportFrom):
            module = "." * node.level + (node.module or "")
            imports += [(module, a.name) for a in node.names]
        elif isinstance(node, ast.Import):
            imports += [(a.name, "") for a in node.names]
        elif isinstance(node, (ast.Name, ast.Attribute)):
            words.append(getattr(node, "id", getattr(node, "attr", "")))
    literal = [name for node in nodes if (name := _literal_import(node))]
    computed = sum(w in IMPORTS_BY_NAME for w in words) - len(literal)
    strings = frozenset(
        node.value
        for node in nodes
        if isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and len(node.value) < LONGEST_NAME
    )
    names = {*words, *(name for _, name in imports)}
    return _Source(
        tuple(imports) + tuple((name, "") for name in literal),
        strings,
        computed > 0 or any(w in RUNS_OTHER_CODE for w in words),
        bool(names & {*GETS_A_CASE}) or (CASES, "") in imports or (PACKAGE, "cases") in imports,
    )


def _literal_import(node: ast.AST) -> str:
    """Return the module of a call such as ``import_module("a.b")``; "" for any other node."""
    if not (isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant)):
        return ""
    called = getattr(node.func, "attr", getattr(node.func, "id", ""))
    value = node.args[0].value
    return value if called in IMPORTS_BY_NAME and isinstance(value, str) else ""


def _find(module: str, name: str, importer: Path) -> tuple[set[str], set[str]]:
    """Return the files or the library to which an import leads."""
    if module.startswith("."):
        level = len(module) - len(module.lstrip("."))
        return _local_files(importer.parents[level - 1], module.lstrip("."), name), set()
    top = module.partition(".")[0]
    if top == PACKAGE:
        words = f"{module}.{name}".removeprefix(CASES).strip(".").split(".")
        in_catalogue = f"{module}.".startswith(f"{CASES}.") and words[0] in locations.case_files()
        return ({locations.case_files()[words[0]]} if in_catalogue else set()), set()
    beside = _local_files(importer.parent, module, name)
    return (beside, set()) if beside else _installed_or_local(module, name)


def _local_files(folder: Path, module: str, name: str) -> set[str]:
    """Return the files of a module below a folder, with the ``__init__`` of the packages on the
    way; an empty set where there is none."""
    files: set[str] = set()
    base = folder
    for word in filter(None, module.split(".")):
        base = base / word
        files |= _module_files(base)
    if name.isidentifier() and (files or not module):
        files |= _module_files(base / name)
    if not files and base != folder and base.is_dir():  # a package without __init__
        files = {str(p) for p in base.rglob("*.py")}
    return files


def _module_files(base: Path) -> set[str]:
    return {str(p) for p in (base / "__init__.py", base.with_suffix(".py")) if p.is_file()}


def _installed_or_local(module: str, name: str) -> tuple[set[str], set[str]]:
    """Return what Python would find for a module: the library where it is installed, else files."""
    top = module.partition(".")[0]
    if top in sys.stdlib_module_names:
        return set(), set()
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, ValueError, AttributeError):
        spec = None
    if spec is None:
        return set(), set()
    origins = [spec.origin] if spec.origin else list(spec.submodule_search_locations or ())
    if not origins:
        return set(), set()
    origin = Path(origins[0])
    if locations.is_installed(origin):
        return set(), {top}
    folder = origin.parent.parent if origin.name == "__init__.py" else origin.parent
    return _local_files(folder, module, name), set()


def _named_file(word: str, folder: Path) -> set[str]:
    """Return the file beside a user's file that one of its strings names."""
    if not word or "\n" in word or "\0" in word or word in (".", ".."):
        return set()
    try:
        place = folder / word
        return {str(place.resolve())} if place.is_file() else set()
    except OSError:
        return set()


def _catalogue_cases(strings: frozenset[str]) -> set[str]:
    """Return the cases of the catalogue that the strings name; all, where they name none."""
    words = {s.partition("[")[0].strip() for s in strings}
    found = locations.case_files()
    return {p for n, p in found.items() if n in words} or {*found.values()}


@functools.cache
def cases_with_side_effects() -> tuple[str, ...]:
    """Return the cases of the catalogue whose import does more than define names.

    All cases are imported to be found, so such a file counts for every run. A call that stands
    alone, a loop, or an assignment to something of another module does more; a call on the right
    of an assignment is taken to do no more than compute its value.
    """
    return tuple(p for p in locations.case_files().values() if _has_side_effects(_text(p)))


@functools.cache
def _has_side_effects(text: str) -> bool:
    try:
        return any(_acts(node) for node in ast.parse(text).body)
    except (SyntaxError, ValueError):
        return False


def _acts(node: ast.stmt) -> bool:
    if isinstance(node, ast.Assign):
        return not all(isinstance(t, (ast.Name, ast.Tuple)) for t in node.targets)
    return not (
        isinstance(node, (ast.Import, ast.ImportFrom, ast.FunctionDef, ast.ClassDef))
        or (isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name))
        or (isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant))
    )


def forget() -> None:
    """Read the files again the next time."""
    for function in (_direct, _text, locations.case_files, cases_with_side_effects):
        function.cache_clear()
