"""What is read off the imports is all that a run imports."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

from nsbench.source_files import import_graph, locations

ROOT = locations.ROOT
FILES = sorted(p for p in (*ROOT.rglob("*.py"), *(ROOT.parent / "cases").glob("*.py")))
PROBES = ("tide", "three_discs", "sliding", "rlc_diode")
SCRIPT = """
import importlib, json, sys
from nsbench import imports, keys, study
from nsbench.study import Spec
names, cases = json.loads(sys.argv[1])
allowed = {(n, c): sorted(keys.watched(Spec(c, n, "h", 0.1), study.resolve(c))) for n in names for c in cases}
out = {}
for name in names:
    for module in [m for m in sys.modules if m.partition(".")[0] == "nsbench"]:
        del sys.modules[module]
    import nsbench.solvers as solvers
    from nsbench import study
    from nsbench.case import parse_spec
    def get(spec):
        base, options = parse_spec(spec)
        return importlib.import_module("nsbench.solvers." + base).SOLVER(**options)
    solvers.get = get                                    # the scan imports all of them
    statuses = []
    for case in cases:
        method, made = get(name), study.resolve(case)
        if method.refuses(made) is None:
            statuses.append(study.attempt(study.Spec(case, name, method.accuracy, study.ladder(made, method)[0]))[0]["status"])
    files = {getattr(m, "__file__", None) or "" for k, m in sys.modules.items() if k.partition(".")[0] == "nsbench"}
    files = {f for f in files if f and "/cases/" not in f}
    out[name] = [statuses, sorted(files - {f for c in cases for f in allowed[name, c]}), len(files)]
print(json.dumps(out))
"""


def by_tree(tree):
    return {(m, n) for m, n in import_graph._imports(tree)}


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT.parent)))
def test_imports_found_by_their_looks_are_those_of_the_syntax_tree(path):
    source = path.read_text(encoding="utf-8")
    tree = ast.parse(source)
    assert set(import_graph._quick(source, False).imports) == by_tree(tree)
    top = [n for n in tree.body if isinstance(n, (ast.Import, ast.ImportFrom))]
    assert set(import_graph._quick(source, True).imports) == by_tree(ast.Module(top, []))
    assert not {getattr(n, "id", getattr(n, "attr", "")) for n in ast.walk(tree)} & {
        *import_graph.BY_NAME
    } or path.stem in ("cli", "case", "__init__"), "imports by a name that it makes"


# what lists of names and the finding of cases load beside what is asked for; none of it is called
# by a run
BESIDE = (
    "study/describe.py",
    "measure/orders/__init__.py",
    "measure/orders/corrected_power_law.py",
    "measure/orders/plateau.py",
    "measure/orders/window.py",
    "reference/build.py",
    "reference/certify/certificate.py",
    "results/run_key.py",
    "source_files/import_graph.py",
    "source_files/locations.py",
    "source_files/opened_files.py",
    "compilation/numba_cache.py",
)


def unknown(names, probes):
    """Of runs of the probes: how they ended, and the files they imported that their keys do not
    know, by solver."""
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, json.dumps([names, probes])], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    return {
        name: (statuses, {Path(p) for p in files} - {ROOT / p for p in BESIDE}, n)
        for name, (statuses, files, n) in found.items()
    }


@pytest.mark.parametrize("names", [("pbd", "kdtree"), ("euler", "solve_ivp")], ids=" ".join)
def test_a_run_imports_nothing_that_its_key_does_not_know(names):
    """Of every solver: tests/studies/imported.py."""
    for name, (statuses, files, n) in unknown(names, ("tide", "sliding")).items():
        assert not files, name
        assert statuses and n > 20
