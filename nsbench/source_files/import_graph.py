"""What a file of Python depends on, read off its text: every import in it, at the top or inside
functions, and so on down.

Nothing is imported. Files of this package are told apart from libraries, which are left as names.
An ``__init__`` that is but a list of names (imports and nothing else, or a table _HOME of a lazy
package) counts with the home of the name that is asked for; any other one counts whole. A file
outside the package is read with more suspicion: modules beside it, files that its strings name,
and, where it imports by names that it makes itself, its whole folder.
"""

from __future__ import annotations

import ast
import functools
import re
import sys
from dataclasses import dataclass
from pathlib import Path

from nsbench.source_files import file_state
from nsbench.source_files.locations import (
    PACKAGE,
    ROOT,
    inside,
    installed_or_local,
    local_module_files,
    module_file,
    named_file,
    plugin_files,
)

LOOKUPS = {
    "solvers": (
        "get",
        "solve",
        "standard",
        "all_names",
        "load",
    ),  # names that find others by a text
    "cases": ("get_case", "case_module", "case_names", "load_case"),
}
# What is said beside rows, and what tells files apart: no number comes from them
NO_NUMBERS = {
    "study/__init__.py": ("describe.py", "pandas"),
    "compilation/numba_setup.py": ("numba_cache.py",),
}
BY_ITSELF = (
    "study/__init__.py",
    "case/registry.py",
    "solvers/__init__.py",
)  # what these look up is the case and the solver of the run
IMPORT = re.compile(
    r"^[ \t]*((?:from[ \t]+[\w.]+[ \t]+import|import)\b[ "
    r"\t]*(?:\((?:[^)#]|#[^\n]*)*\)|(?:[^\n#;\\]|\\\n)*))",
    re.M,
)
BY_NAME = (
    "import_module",
    "__import__",
    "spec_from_file_location",
    "run_path",
    "run_module",
    "exec",
    "eval",
)


@dataclass(frozen=True)
class Dependencies:
    """files: paths of all files, the first one included; libraries: top-level names of what is
    installed beside them."""

    files: frozenset[str]
    libraries: frozenset[str]


@dataclass(frozen=True)
class _Text:
    """One file: imports as (module, name), name "" for the module itself; strings: what it spells
    out; by_name: it imports by names that it makes itself."""

    imports: tuple[tuple[str, str], ...]
    strings: frozenset[str] = frozenset()
    by_name: bool = False


def dependencies(*paths, top: bool = False) -> Dependencies:
    """Everything the files depend on, themselves included. top: only what importing them imports,
    and not what their functions do."""
    todo = [str(Path(p).resolve()) for p in paths]
    files = set()
    libraries = set()
    while todo:
        path = todo.pop()
        if path in files:
            continue
        files.add(path)
        for kind, what in direct(path, top):
            if kind == "library":
                libraries.add(what)
            elif kind == "text":
                files.add(what) if _is_list(what) else todo.append(what)
            else:
                todo.append(what)
    return Dependencies(frozenset(files), frozenset(libraries))


@functools.cache
def direct(path: str, top: bool = False) -> frozenset[tuple[str, str]]:
    """What one file needs itself: ("file", path), ("text", path of an __init__), ("library",
    name)."""
    here = Path(path)
    if here.suffix != ".py":
        return frozenset()
    ours = inside(here)
    if ours and here.name == "__init__.py" and _is_list(path):
        return frozenset()
    text = _quick(_source(path), top) if ours else _careful(_source(path))
    out = set()
    for module, name in text.imports:
        out |= _target(module, name, here, ours)
    out |= _found_by_text(text, here, ours)
    silent = NO_NUMBERS.get(
        here.relative_to(ROOT).as_posix() if here.is_relative_to(ROOT) else "", ()
    )
    return frozenset((kind, what) for kind, what in out if Path(what).name not in silent)


@functools.cache
def _source(path: str) -> str:
    file_state.record_state(path)
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""


@functools.cache
def _quick(source: str, top: bool) -> _Text:
    """Of a file of the package: statements of import by the look of their lines, which takes a
    fiftieth of parsing it. A line of a docstring that looks like one counts too."""
    imports: list[tuple[str, str]] = []
    for match in IMPORT.finditer(source):
        if top and match[0][0] in " \t":
            continue
        try:
            tree = ast.parse(match[1].strip())
        except SyntaxError:  # a line of prose
            continue
        imports += _imports(tree)
    if _looks_up("solvers", imports) or _looks_up("cases", imports):
        return _Text(tuple(imports), _strings(ast.parse(source)))
    return _Text(tuple(imports))


def _imports(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            yield from (("." * node.level + (node.module or ""), a.name) for a in node.names)
        elif isinstance(node, ast.Import):
            yield from ((a.name, "") for a in node.names)


def _looks_up(kind: str, imports) -> bool:
    """Whether solvers or cases are found by a text that is not known from the imports."""
    home = f"{PACKAGE}.{'solvers' if kind == 'solvers' else 'case'}"
    return any(
        (m in (PACKAGE, home) and n in LOOKUPS[kind])
        or (kind == "solvers" and (m, n) in ((PACKAGE, "solvers"), (home, "")))
        for m, n in imports
    )


def _strings(tree) -> frozenset[str]:
    return frozenset(
        n.value
        for n in ast.walk(tree)
        if isinstance(n, ast.Constant) and isinstance(n.value, str) and len(n.value) < 300
    )


@functools.cache
def _careful(source: str) -> _Text:
    """Of somebody else's file, by its syntax tree; a file that cannot be parsed has no imports."""
    try:
        tree = ast.parse(source)
    except (SyntaxError, ValueError):
        return _Text(())
    imports = [*_imports(tree), *_chains(tree)]
    words = 0
    for node in ast.walk(tree):
        words += getattr(node, "id", getattr(node, "attr", "")) in BY_NAME
        if (
            isinstance(node, ast.Call)
            and _called(node) in ("import_module", "__import__")
            and node.args
            and isinstance(node.args[0], ast.Constant)
            and isinstance(node.args[0].value, str)
        ):
            imports.append((node.args[0].value, ""))
            words -= 1
    return _Text(tuple(imports), _strings(tree), words > 0)


def _called(node: ast.Call) -> str:
    return getattr(node.func, "attr", getattr(node.func, "id", ""))


def _chains(tree):
    """Names taken from the package as a module: ``nsbench.measure.errors`` is (nsbench.measure,
    errors) and its parents."""
    heads = {
        a.asname or a.name.partition(".")[0]: a.name if a.asname else a.name.partition(".")[0]
        for node in ast.walk(tree)
        if isinstance(node, ast.Import)
        for a in node.names
        if a.name.partition(".")[0] == PACKAGE
    }
    for node in ast.walk(tree):
        words = []
        while isinstance(node, ast.Attribute):
            words.append(node.attr)
            node = node.value
        if isinstance(node, ast.Name) and node.id in heads and words:
            module = heads[node.id]
            for word in reversed(words):
                yield module, word
                module += f".{word}"


def _target(module: str, name: str, here: Path, ours: bool) -> set[tuple[str, str]]:
    """Where an import leads."""
    if module.startswith("."):
        base = here.parents[len(module) - len(module.lstrip(".")) - 1]
        return local_module_files(base, module.lstrip("."), name)
    top = module.partition(".")[0]
    if top == PACKAGE:
        return _in_package(module, name)
    if ours:
        return set() if top in sys.stdlib_module_names else {("library", top)}
    return local_module_files(here.parent, module, name) or installed_or_local(module, name)


def _in_package(module: str, name: str) -> set[tuple[str, str]]:
    parts = module.split(".")
    out = {
        ("text", str(p)) for k in range(1, len(parts)) if (p := module_file(".".join(parts[:k])))
    }
    place = module_file(module)
    if place is None:
        return out
    path = str(place)
    if place.name != "__init__.py":
        return out | {("file", path)}
    out.add(("text", path))
    inner = module_file(f"{module}.{name}") if name else None
    if inner is not None:
        out.add(("text" if inner.name == "__init__.py" else "file", str(inner)))
    if _is_list(path):
        table = _names(path)
        for home, its_name in (
            [table[name]] if name in table else [] if inner or not name else table.values()
        ):
            out |= _in_package(home, its_name)
    return out


@functools.cache
def _is_list(path: str) -> bool:
    """Whether an __init__ of this package only tells where names live."""
    place = Path(path)
    if place.name != "__init__.py" or not inside(place):
        return False
    body = _body(_source(path))
    if _table(body):
        return True
    return all(
        isinstance(n, (ast.Import, ast.ImportFrom)) or _is_docstring(n) or _assigns(n, "__all__")
        for n in body
    )


@functools.cache
def _body(source: str) -> list[ast.stmt]:
    return ast.parse(source).body


def _is_docstring(node) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def _assigns(node, name) -> bool:
    return isinstance(node, ast.Assign) and [getattr(t, "id", "") for t in node.targets] == [name]


def _table(body) -> dict[str, str]:
    return next((ast.literal_eval(n.value) for n in body if _assigns(n, "_HOME")), {})


@functools.cache
def _names(path: str) -> dict[str, tuple[str, str]]:
    """Where the names of such an __init__ live: name -> (module, name there)."""
    body = _body(_source(path))
    table = {n: (f"{PACKAGE}.{home}", n) for n, home in _table(body).items()}
    for node in body:
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(PACKAGE):
            table |= {a.asname or a.name: (node.module, a.name) for a in node.names}
    return table


def _found_by_text(text: _Text, here: Path, ours: bool) -> set[tuple[str, str]]:
    """What a file finds by a text: solvers and cases that it looks up, and for a foreign file those
    it names or may name."""
    out: set[tuple[str, str]] = set()
    if not (here.is_relative_to(ROOT) and here.relative_to(ROOT).as_posix() in BY_ITSELF):
        for kind in LOOKUPS:
            if _looks_up(kind, text.imports):
                out |= _named(plugin_files(kind), text.strings)
    if ours:
        return out
    for word in text.strings:
        out |= named_file(word, here.parent)
    if text.by_name:
        out |= {("file", str(p)) for p in sorted(here.parent.glob("*.py"))}
    return out


def _named(found: dict[str, str], strings) -> set[tuple[str, str]]:
    """Those that the strings name; where they name none, all."""
    words = {s.partition("[")[0].strip() for s in strings}
    return {("file", p) for n, p in found.items() if n in words} or {
        ("file", p) for p in found.values()
    }


ACTS = re.compile(
    r"^(?:if|for|while|with|try|del)\b|^[A-Za-z_][\w.]*(?:\[[^\]\n]*\])*(?:\(|\s*[-+*/|&@]=)|"
    r"^[A-Za-z_]\w*(?:\.\w+|\[[^\]\n]*\])+\s*=[^=]",
    re.M,
)


def has_import_side_effects(path: Path) -> bool:
    """Whether importing the file does more than define names: a call that stands alone, a loop, an
    assignment to what is another's. What an assignment calls for its value is taken to do no more
    than make it."""
    return _does_more(_source(str(path)))


@functools.cache
def _does_more(source: str) -> bool:
    return bool(ACTS.search(source)) and any(_acts(node) for node in ast.parse(source).body)


def _acts(node) -> bool:
    if isinstance(node, ast.Assign):
        return not all(isinstance(t, (ast.Name, ast.Tuple)) for t in node.targets)
    return not (
        isinstance(node, (ast.Import, ast.ImportFrom, ast.FunctionDef, ast.ClassDef))
        or (isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name))
        or _is_docstring(node)
    )


def forget() -> None:
    """Files are read again."""
    for f in (direct, _source, _is_list, _names, module_file):
        f.cache_clear()
