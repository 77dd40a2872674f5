"""Which files of the checkout import which: read from the sources, nothing is executed."""

import ast
import functools
from pathlib import Path

from copies import ROOT


def file_of(module: str, root: Path = ROOT) -> str:
    """Return the file of a module of the package, "" for any other."""
    path = root.joinpath(*module.split("."))
    for file in (path.with_suffix(".py"), path / "__init__.py"):
        if module.split(".")[0] == "nsbench" and file.is_file():
            return file.relative_to(root).as_posix()
    return ""


@functools.cache
def imported(file: str, root: Path = ROOT) -> frozenset[str]:
    """Return the files of the package that a file imports itself, anywhere in it.

    `from package import name` is an import of the module where the package has one of that name,
    else of the package.
    """
    found = set()
    for node in ast.walk(ast.parse((root / file).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {file_of(a.name, root) for a in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for a in node.names:
                found.add(file_of(f"{node.module}.{a.name}", root) or file_of(node.module, root))
    return frozenset(found - {"", file})


def reached(file: str, root: Path = ROOT) -> set[str]:
    """Return the files of the package that a file imports, and those that they import."""
    out: set[str] = set()
    todo = [file]
    while todo:
        for other in imported(todo.pop(), root) - out:
            out.add(other)
            todo.append(other)
    return out


def tests_of(file: str) -> list[str]:
    """Return the test files that import a file of the package, or the nearest ones that do so
    through others, and those of the folder that bears the name of its room."""
    tests = [p.relative_to(ROOT).as_posix() for p in sorted((ROOT / "tests").rglob("test_*.py"))]
    sources = [p.relative_to(ROOT).as_posix() for p in sorted((ROOT / "nsbench").rglob("*.py"))]
    level = {file}
    seen = set(level)
    folders = file.split("/")[1:-1]
    near = [t for t in tests if t.split("/")[1:-1] == folders[: t.count("/") - 1]]
    deepest = max((t.count("/") for t in near), default=0)
    of_room = [t for t in near if t.count("/") == deepest > 1]
    while level:
        found = [t for t in tests if imported(t) & level]
        if found:
            return list(dict.fromkeys(found + of_room))
        level = {s for s in sources if imported(s) & level} - seen - {"nsbench/__init__.py"}
        seen |= level
    return of_room
