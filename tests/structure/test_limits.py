"""The form of the code: sizes, one assignment a line, named state, kernels that import kernels."""

import ast
from collections import Counter
from pathlib import Path

import pytest

import nsbench

PACKAGE = Path(nsbench.__file__).parent
FILES = sorted(PACKAGE.rglob("*.py"))
MAX_COLUMNS = 100
MAX_LINES = 400  # of a file
MAX_FUNCTION = 60  # lines
MAX_FILES = 20  # of a folder
KERNEL_FOLDERS = ("linalg", "lcp")  # compiled throughout, beside all folders named kernels
# what a kernel may import beside other kernels
KERNEL_LIBRARIES = {"__future__", "collections", "enum", "numba", "numpy", "typing", "math"}
# arrays, not tuples, whose entries are taken by number: of a box, of a program, of a layout
ARRAYS = {"num", "ends", "first", "surface_and_modes"}
# one folder of a method may build on another openly
BUILDS_ON = {("pbd_jax", "pbd")}


def name(path):
    return path.relative_to(PACKAGE).as_posix()


def is_kernel(path):
    parts = path.relative_to(PACKAGE).parts
    return "kernels" in parts[:-1] or parts[0] in KERNEL_FOLDERS


def module_of(path):
    parts = ("nsbench", *path.relative_to(PACKAGE).with_suffix("").parts)
    return ".".join(parts).removesuffix(".__init__")


MODULES = {module_of(p): p for p in FILES}


def imported(path):
    """Modules that a file imports anywhere: of nsbench as files, of others by their top name."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            names = [node.module, *(f"{node.module}.{a.name}" for a in node.names)]
        elif isinstance(node, ast.Import):
            names = [a.name for a in node.names]
        else:
            continue
        found = [n for n in names if n in MODULES]
        inner = [n for n in found if n != node.__dict__.get("module")]
        yield from inner or found or [names[0].partition(".")[0]]


@pytest.mark.parametrize("path", FILES, ids=name)
def test_lines_fit_in_100_columns(path):
    lines = path.read_text(encoding="utf-8").splitlines()
    assert not [k for k, line in enumerate(lines, 1) if len(line) > MAX_COLUMNS]


@pytest.mark.parametrize("path", FILES, ids=name)
def test_files_and_functions_are_short(path):
    source = path.read_text(encoding="utf-8")
    assert len(source.splitlines()) <= MAX_LINES
    functions = [
        n
        for n in ast.walk(ast.parse(source))
        if isinstance(n, (ast.FunctionDef, ast.AsyncFunctionDef))
    ]
    for f in functions:
        assert f.end_lineno - f.lineno + 1 <= MAX_FUNCTION, f.name


def test_folders_hold_at_most_twenty_files():
    count = Counter(p.parent for p in FILES)
    assert not {name(folder): k for folder, k in count.items() if k > MAX_FILES}


@pytest.mark.parametrize("path", FILES, ids=name)
def test_every_file_says_what_it_computes(path):
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
    assert text or not path.read_text(encoding="utf-8").strip()
    assert not text or text.splitlines()[0].endswith((".", "?")), "it ends in mid-sentence"


@pytest.mark.parametrize("path", FILES, ids=name)
def test_one_assignment_a_line(path):
    """A tuple is assigned to a tuple only where a later value reads an earlier target, as a swap
    does."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.Assign) or not isinstance(node.value, ast.Tuple):
            continue
        target = node.targets[0]
        if not isinstance(target, ast.Tuple) or not all(
            isinstance(t, ast.Name) for t in target.elts
        ):
            continue
        written = {t.id for t in target.elts}
        read = {n.id for n in ast.walk(node.value) if isinstance(n, ast.Name)}
        starred = any(isinstance(v, ast.Starred) for v in node.value.elts)
        assert starred or written & read, f"line {node.lineno}"


@pytest.mark.parametrize("path", [p for p in FILES if is_kernel(p)], ids=name)
def test_kernels_import_kernels_and_name_their_state(path):
    for module in imported(path):
        if module in MODULES:
            assert is_kernel(MODULES[module]) or module.startswith("nsbench.compilation"), module
        else:
            assert module in KERNEL_LIBRARIES, module
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant):
            index = node.slice.value
            array = getattr(node.value, "id", "") in ARRAYS
            assert array or not (isinstance(index, int) and index > 1), f"line {node.lineno}"


@pytest.mark.parametrize("path", sorted((PACKAGE / "solvers").glob("*/**/*.py")), ids=name)
def test_no_method_imports_from_the_folder_of_another(path):
    here = path.relative_to(PACKAGE / "solvers").parts[0]
    for module in imported(path):
        parts = module.split(".")
        if parts[:2] == ["nsbench", "solvers"] and len(parts) > 2:
            there = parts[2]
            folder = (PACKAGE / "solvers" / there).is_dir()
            allowed = there in (here, "common") or here == "common" or (here, there) in BUILDS_ON
            assert allowed or not folder, module
