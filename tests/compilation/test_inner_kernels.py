"""Kernels without machine code of their own: what calls them, and what they may do."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest

from nsbench.compilation.decorators import python_entry, fused_kernel, inner_kernel, njit
from nsbench.compilation.inner_compiler import LinkedLibrary
from nsbench.source_files.kernel_files import kernel_files
from nsbench.source_files.locations import ROOT


def libraries_of(kernel):
    return [c.library for c in kernel.overloads.values()]


@inner_kernel
def squares(x: np.ndarray) -> np.ndarray:
    """Return the squares."""
    return x * x


@fused_kernel
def total(x: np.ndarray) -> float:
    """Return the sum of squares."""
    return squares(x).sum()


@njit
def length(x: np.ndarray) -> float:
    """Return the 2-norm."""
    return np.sqrt(total(x))


@inner_kernel
def refused(n: int) -> int:
    """Raise ValueError with a message that is put together at run time."""
    if n > 2:
        raise ValueError("more than", n)
    return n


@njit
def passed_on(n: int) -> int:
    """Return n from a kernel that needs its environment."""
    return refused(n)


def test_kernels_are_linked_into_their_callers_without_machine_code():
    """Numba's own way would optimise and translate each of them, and again in each caller."""
    assert length(np.array([3.0, 4.0])) == 5.0
    for kernel in (squares, total):
        (library,) = libraries_of(kernel)
        assert isinstance(library, LinkedLibrary) and not library._has_machine_code
    (library,) = libraries_of(length)
    assert not isinstance(library, LinkedLibrary)


def test_kernels_that_need_their_environment_get_it():
    """An exception whose arguments are known at run time alone is made by the environment."""
    assert passed_on(2) == 2
    with pytest.raises(ValueError, match="more than.*3"):
        passed_on(3)
    (library,) = libraries_of(refused)
    assert library._has_machine_code


def test_a_call_from_python_is_refused():
    """There is no address to call."""
    length(np.array([3.0, 4.0]))
    with pytest.raises(TypeError):
        squares(np.array([3.0]))
    with pytest.raises(TypeError):
        total(np.array([3.0]))


def test_an_entry_from_python_is_made_once():
    """Host loops, which numba cannot compile, call kernels by it; other kernels are their own."""
    entry = python_entry(total)
    assert entry(np.array([3.0, 4.0])) == 25.0
    assert python_entry(total) is entry
    assert python_entry(length) is length


INNER = ("inner_kernel", "fused_kernel", "summing")
LOADED = ("kernel", "kernels")  # attributes that hold a module of kernels


def module_of(path: Path) -> str:
    return ".".join(("nsbench", *path.relative_to(ROOT).with_suffix("").parts))


class Callers:
    """Which kernels are decorated how, and which of them Python code refers to."""

    def __init__(self):
        trees = {p: ast.parse(p.read_text(encoding="utf-8")) for p in ROOT.rglob("*.py")}
        files = {*kernel_files()}
        self.decorators = {}
        self.imported = {}  # (module, name): where a kernel file has it from
        for path in files:
            for f in trees[path].body:
                if isinstance(f, ast.FunctionDef) and f.decorator_list:
                    self.decorators[module_of(path), f.name] = ast.unparse(f.decorator_list[0])
            for name, sources in self.names(trees[path]).items():
                self.imported[module_of(path), name] = next(iter(sources))
        self.of_python = set()
        for path, tree in trees.items():
            own = module_of(path) if path in files else ""
            body = [f for f in tree.body if not (own and self.is_no_python(f))]
            self.of_python |= self.referred_to(tree, body, own)

    @staticmethod
    def is_no_python(statement) -> bool:
        """A kernel itself, or an import."""
        kernel = isinstance(statement, ast.FunctionDef) and statement.decorator_list
        return bool(kernel) or isinstance(statement, (ast.Import, ast.ImportFrom))

    @staticmethod
    def names(tree) -> dict:
        found = {}
        for n in ast.walk(tree):
            for a in n.names if isinstance(n, ast.ImportFrom) and n.module else ():
                found.setdefault(a.asname or a.name, set()).add((n.module, a.name))
        return found

    def kernel(self, key):
        while key not in self.decorators and key in self.imported:
            key = self.imported[key]
        return key if key in self.decorators else None

    def referred_to(self, tree, body, own) -> set:
        names = self.names(tree)
        found = set()
        for n in (n for statement in body for n in ast.walk(statement)):
            if isinstance(n, ast.Name):
                found |= {self.kernel(k) for k in names.get(n.id, {(own, n.id)})}
            elif isinstance(n, ast.Attribute):
                last = ast.unparse(n.value).rpartition(".")[2]
                found |= {self.kernel((f"{m}.{k}", n.attr)) for m, k in names.get(last, ())}
                if last in LOADED:
                    found |= {k for k in self.decorators if k[1] == n.attr}
        return found - {None}


def test_kernels_that_python_calls_have_an_entry_and_others_have_none():
    """An entry costs machine code of its own; without one a call raises TypeError."""
    callers = Callers()
    kernels = callers.decorators
    assert len(kernels) > 300 and len(callers.of_python) > 50
    called = {k for k in callers.of_python if kernels[k].startswith(INNER)}
    # one goes by its function in Python
    assert called <= {("nsbench.solvers.pbd.kernels.cell_storage", "candidate_arrays")}
    stored = {k for k, d in kernels.items() if d.startswith("njit") and "inline" not in d}
    assert not stored - callers.of_python
