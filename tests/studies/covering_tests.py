"""Which tests run a line of the package: a map made by coverage.py, with the seconds of each test.

One run of the tests in a copy of the checkout notes for each line which tests came by. Compiled
kernels leave no trace: for them the tests are meant that import the kernel, then those that run
the functions of the Python files which call it.
"""

import ast
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator
from pathlib import Path

from imports import imported

DATA = ".coverage"
TIMES = "test_times.xml"
SETTINGS = "coverage.rc"


def make_map(folder: Path, env: dict) -> None:
    """Run the quick tests of a copy under coverage; the map and the times are left in the copy."""
    (folder / SETTINGS).write_text("[run]\nsource = nsbench\nparallel = true\n", encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not long"]
    command += ["--cov=nsbench", f"--cov-config={SETTINGS}", "--cov-context=test"]
    command += ["--cov-report=", f"--junitxml={TIMES}", "tests"]
    subprocess.run(command, cwd=folder, env=env, check=False, stdout=subprocess.DEVNULL)


class CoveringTests:
    """The map of one copy: ids of tests that passed, the quick ones first."""

    def __init__(self, folder: Path, is_kernel: Callable[[str], bool]):
        from coverage import CoverageData

        self.folder = folder
        self.is_kernel = is_kernel
        self.data = CoverageData(str(folder / DATA))
        self.data.read()
        self.seconds = dict(passed(folder / TIMES))
        self.sources = [
            p.relative_to(folder).as_posix() for p in sorted((folder / "nsbench").rglob("*.py"))
        ]

    def of(self, file: str, line: int) -> list[str]:
        """Return the tests that run a line, or where none is known those that run its file."""
        if self.is_kernel(file):
            return self.of_kernel(file)
        first, last = statement(self.folder / file, line)
        return self.running(file, range(first, last + 1)) or self.running_functions(file)

    def running(self, file: str, lines) -> list[str]:
        """Return the tests that run one of the lines of a file."""
        found = self.data.contexts_by_lineno(str(self.folder / file))
        tests = {context.partition("|")[0] for line in lines for context in found.get(line, ())}
        return sorted(tests & self.seconds.keys(), key=self.seconds.get)

    def running_functions(self, file: str) -> list[str]:
        """Return the tests that run a function of a file."""
        tree = ast.parse((self.folder / file).read_text(encoding="utf-8"))
        lines = {
            line
            for node in ast.walk(tree)
            if isinstance(node, ast.FunctionDef)
            for line in range(node.body[0].lineno, node.end_lineno + 1)
        }
        return self.running(file, lines)

    def of_kernel(self, file: str) -> list[str]:
        """Return the tests that import a kernel, then those that run its callers in Python."""
        direct = [t for t in self.seconds if file in imported(t.partition("::")[0], self.folder)]
        tests = dict.fromkeys(sorted(direct, key=self.seconds.get))
        level, seen = {file}, {file}
        while level:
            users = {s for s in self.sources if imported(s, self.folder) & level} - seen
            seen |= users
            level = {u for u in users if self.is_kernel(u)}
            running = {t for u in users - level for t in self.running_functions(u)}
            tests |= dict.fromkeys(sorted(running, key=self.seconds.get))
        return list(tests)


def passed(path: Path) -> Iterator[tuple[str, float]]:
    """Yield id and seconds of the tests that passed, from pytest's table."""
    for case in ElementTree.parse(path).iter("testcase"):
        if len(case) == 0:  # no failure, no skip
            module = case.get("classname", "").replace(".", "/")
            yield f"{module}.py::{case.get('name')}", float(case.get("time", 0.0))


def statement(path: Path, line: int) -> tuple[int, int]:
    """Return first and last line of the statement at a line; of a compound one its head."""
    best = (line, line)
    width = float("inf")
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.stmt) and node.lineno <= line <= node.end_lineno:
            body = getattr(node, "body", None)
            last = max(node.lineno, body[0].lineno - 1) if body else node.end_lineno
            if line <= last and last - node.lineno < width:
                best, width = (node.lineno, last), last - node.lineno
    return best
