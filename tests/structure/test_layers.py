"""Imports point one way, and what is not needed is not imported."""

import ast
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import nsbench

ROOT = Path(nsbench.__file__).parent
LAYERS = [
    "cases",
    "reference_solutions",
    "html_summary",
    "input_errors",
    "problem",
    "trajectory",
    "columns",
    "user_code",
    "source_files",
    "compilation",
    "case",
    "linalg",
    "lcp",
    "qp",
    "dynamics",
    "diagnostics",
    "error_bars",
    "solvers",
    "reference",
    "measure",
    "study",
    "results",
    "report",
    "plots",
    "studies",
    "execute",
    "gate",
    "cli",
]
HEAVY = (
    "jax",
    "numba",
    "cvxpy",
    "pandas",
    "matplotlib",
    "scipy",
    "diffrax",
    "osqp",
    "pyarrow",
    "flint",
    "distributed",
    "dask",
    "jinja2",
    "shtab",
    "tqdm",
    "psutil",
    "vl_convert",
)


def layer(module):
    return module.split(".")[1] if "." in module else module


def imports(path):
    """Modules of nsbench that a file imports, at the top or inside functions."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("nsbench"):
            if node.module == "nsbench":
                yield from (f"nsbench.{a.name}" for a in node.names)
            else:
                yield node.module
        elif isinstance(node, ast.Import):
            yield from (a.name for a in node.names if a.name.startswith("nsbench."))


@pytest.mark.parametrize("path", sorted(ROOT.rglob("*.py")), ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_point_one_way(path):
    here = path.relative_to(ROOT).parts[0].removesuffix(".py")
    if here in ("__init__", "__main__"):
        return
    for module in imports(path):
        there = layer(module)
        if there not in nsbench.__all__:  # a folder or file that is not listed is an error
            assert LAYERS.index(there) <= LAYERS.index(here), f"{here} imports {module}"


def test_cases_import_only_what_a_case_file_may():
    for path in sorted((ROOT.parent / "cases").glob("*.py")):
        assert set(imports(path)) <= {f"nsbench.{n}" for n in nsbench.__all__} | {
            "nsbench.problem",
            "nsbench.case",
        }, path


def test_every_folder_is_installed():
    """A folder that pyproject.toml does not list is there for the developers only."""
    listed = tomllib.loads((ROOT.parent / "pyproject.toml").read_text(encoding="utf-8"))["tool"][
        "setuptools"
    ]["packages"]
    here = {".".join(p.parent.relative_to(ROOT.parent).parts) for p in ROOT.rglob("__init__.py")}
    assert here | {"nsbench.cases", "nsbench.reference_solutions"} == set(listed)


def loaded_by(code):
    out = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys; print(*sys.modules)"],
        capture_output=True,
        text=True,
        check=True,
    )
    names = {m.split(".")[0] for m in out.stdout.splitlines()[-1].split()}
    return names, set(out.stdout.splitlines()[-1].split())


@pytest.mark.parametrize(
    "code",
    [
        "import nsbench",
        "from nsbench.cli import main\ntry: main(['--help'])\nexcept SystemExit: pass",
        "from nsbench.cli import main\nmain(['list'])",
        "from nsbench.cli import main\nmain(['study', 'list'])",
        "import nsbench; nsbench.get_case('discs', n=30)",
    ],
    ids=["import", "help", "list", "study list", "get_case"],
)
def test_start_up_imports_nothing_heavy(code):
    assert not loaded_by(code)[0] & set(HEAVY)


def test_apple_under_pbd_models_only_what_it_needs():
    """Neither jax nor scipy.spatial, and no kernel for particles."""
    top, modules = loaded_by("import nsbench; nsbench.solve('apple', 'pbd', h=0.01)")
    assert not top & {"jax", "diffrax", "cvxpy", "pandas", "matplotlib"}
    assert "scipy.spatial" not in modules
    assert (
        not {
            "nsbench.dynamics.contacts.kernels.cell_list",
            "nsbench.solvers.pbd.kernels.neighbor_loop",
        }
        & modules
    )


def test_public_names_are_few_and_none_is_a_module():
    # two of them, Trajectory and Study, name what others return; Hybrid and Transition are the
    # fourth problem class and the records that it is made of, as families are of Complementarity;
    # from_function is the way in for who has a function of solve_ivp, beside Case, the general one
    assert len(nsbench.__all__) <= 20
    modules = {p.stem for p in ROOT.glob("*.py")} | {p.name for p in ROOT.iterdir() if p.is_dir()}
    assert not modules & set(nsbench.__all__)
