"""Editing a file makes exactly those runs again that depend on it."""

import dataclasses
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import nsbench
from nsbench import get_case
from nsbench.results import run_key
from nsbench.study import Spec

ROOT = Path(nsbench.__file__).parent.parent
SOLVERS = (
    "catching_up",
    "euler",
    "event_driven",
    "kdtree",
    "nosnoc",
    "pbd",
    "pbd_jax",
    "penalty",
    "richardson",
    "solve_ivp",
    "theta",
    "own",
)
CASES = ("tide", "sliding", "mine")
MINE = """
from beside import table
CASE = table()
"""
BESIDE = """
import importlib
from pathlib import Path
import numpy as np
from nsbench import Affine, Case, Complementarity
START = float((Path(__file__).parent / "start.txt").read_text())
FACTOR = float((Path(__file__).parent / ("fac" + "tor.txt")).read_text())
far = importlib.import_module("deep.far")
def table():
    return Case(name="mine", problem=Complementarity(lambda xp: lambda t, x: -x, (Affine(np.eye(1), np.zeros(1)),)),
                x0=np.array([START]), t=np.linspace(0.0, 1.0, 5))
"""
OWN = '''
from dataclasses import dataclass
from nsbench import solvers
from nsbench.solvers import Claims
@dataclass(frozen=True)
class Own:
    """Own."""
    accuracy, default, claims = "h", 0.01, Claims()
    def refuses(self, case):
        return None
    def prepare(self, case, h):
        from tool import factor
        return solvers.get("kdtree").prepare(case, factor * h)
SOLVER = Own
'''
FILES = {
    "mine.py": MINE,
    "beside.py": BESIDE,
    "start.txt": "0.5",
    "factor.txt": "1.0",
    "deep/__init__.py": "",
    "deep/far.py": "",
    "deep/unused.py": "",
    "own.py": OWN,
    "tool.py": "factor = 1.0",
    "other.py": "x = 1",
}
SCRIPT = """
import json, sys
from pathlib import Path
folder, user = map(Path, sys.argv[1:3])
edits, cases, names = json.loads(sys.argv[3])
sys.path[:0] = [str(folder), str(user)]
from nsbench import solvers
from nsbench.results import run_key
from nsbench.source_files import opened_files, user_imports
from nsbench.study.plan import Spec, resolve
if sys.argv[4]:
    exec(sys.argv[4])
own, mine = str(user / "own.py"), str(user / "mine.py")
solvers.load(own)
specs = [Spec(c, s, "h", 0.1, mine if c == "mine" else "", (own,)) for c in cases for s in names]
def found():
    run_key.forget()
    return {s: run_key.key_of(s, run_key.parts_of(s, resolve(s.case, s.file))) for s in specs}
before, out = found(), {}
for file, more in edits:
    place = (user if (user / file).exists() else folder) / file
    old = place.read_bytes()
    place.write_bytes(old + more.encode())
    after = found()
    out[file + more] = [[s.case, s.solver] for s in specs if after[s] != before[s]]
    place.write_bytes(old)
assert found() == before
print(json.dumps(out))
"""
EVERY = {(c, s) for c in CASES for s in SOLVERS}


def rows(cases=CASES, solvers=SOLVERS):
    return {(c, s) for c in cases for s in solvers}


LINE = "\n# another line\n"
EXPECTED = {  # written by hand
    "nsbench/cases/tide.py": rows(["tide"]),
    "nsbench/reference_solutions/sliding.json": rows(["sliding"]),
    # who edits the package makes every run again
    "nsbench/solvers/pbd/method.py": EVERY,
    "nsbench/solvers/theta/kernels/loop.py": EVERY,
    "nsbench/measure/errors.py": EVERY,
    "nsbench/report/tables/cells.py": EVERY,
    "mine.py": rows(["mine"]),
    "beside.py": rows(["mine"]),
    "start.txt": rows(["mine"]),
    "factor.txt": rows(["mine"]),
    "deep/far.py": rows(["mine"]),
    "own.py": rows(solvers=["own"]),
    "tool.py": rows(solvers=["own"]),
    "other.py": set(),
    "deep/unused.py": set(),
}


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    folder = tmp_path_factory.mktemp("copy")
    shutil.copytree(
        ROOT / "nsbench", folder / "nsbench", ignore=shutil.ignore_patterns("__pycache__")
    )
    shutil.copytree(
        ROOT / "cases", folder / "nsbench" / "cases", ignore=shutil.ignore_patterns("__pycache__")
    )
    shutil.copytree(
        ROOT / "reference_solutions",
        folder / "nsbench" / "reference_solutions",
        ignore=shutil.ignore_patterns("__pycache__", "discs*", "ep*"),
    )
    user = folder / "user"
    for name, text in FILES.items():
        (user / name).parent.mkdir(parents=True, exist_ok=True)
        (user / name).write_text(text)
    return folder, user


def invalidated(copy, edits, mutation=""):
    env = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            SCRIPT,
            *map(str, copy),
            json.dumps([edits, CASES, SOLVERS]),
            mutation,
        ],
        capture_output=True,
        text=True,
        env=env | {"PYTHONDONTWRITEBYTECODE": "1"},
    )
    assert done.returncode == 0, done.stderr
    return {name: {tuple(r) for r in found} for name, found in json.loads(done.stdout).items()}


@pytest.fixture(scope="module")
def found(copy):
    return invalidated(copy, [(file, LINE) for file in EXPECTED])


@pytest.mark.survives("stale")
@pytest.mark.parametrize("file", EXPECTED)
def test_an_edit_invalidates_what_depends_on_it_and_nothing_else(found, file):
    assert found[file + LINE] == EXPECTED[file]


def test_a_file_that_acts_when_it_is_imported_counts_for_every_run(copy):
    edits = [
        ("nsbench/cases/wheel.py", "\nnp.pi = 3.0\n"),
        ("nsbench/cases/wheel.py", "\nANOTHER = dict(a=1)\n"),
    ]
    assert [*invalidated(copy, edits).values()] == [EVERY, set()]


def test_a_case_made_of_one_of_the_catalogue_depends_on_its_file(copy):
    mine = copy[1] / "mine.py"
    mine.write_text('from nsbench import get_case\nCASE = get_case("tide").replace(name="mine")\n')
    try:
        edits = [("nsbench/cases/tide.py", LINE), ("nsbench/cases/wheel.py", LINE)]
        assert [*invalidated(copy, edits).values()] == [rows(["tide", "mine"]), set()]
    finally:
        mine.write_text(MINE)


def test_a_file_that_makes_up_what_it_imports_depends_on_its_whole_folder(copy):
    mine = copy[1] / "mine.py"
    mine.write_text(MINE + 'import importlib\nimportlib.import_module("".join(["be", "side"]))\n')
    try:
        assert invalidated(copy, [("other.py", LINE)])["other.py" + LINE] == rows(["mine"])
    finally:
        mine.write_text(MINE)


@pytest.mark.long
@pytest.mark.parametrize(
    "mutation, missed",
    [
        ("user_imports._local_files = lambda *a: set()", "tool.py"),
        ("run_key._contents = lambda paths, home: {}", "mine.py"),
        (
            "import functools\nrun_key.package.package_files = functools.cache(lambda: ())",
            "nsbench/measure/errors.py",
        ),
        (
            "import contextlib\nopened_files.record_opens_while_loading = contextlib.nullcontext",
            "factor.txt",
        ),
    ],
)
def test_a_key_that_forgets_something_is_found_out(copy, mutation, missed):
    assert invalidated(copy, [(missed, LINE)], mutation)[missed + LINE] != EXPECTED[missed]


@pytest.mark.survives("stale")
def test_what_was_asked_for_versions_and_settings_are_part_of_a_key(monkeypatch):
    case = get_case("tide")
    asked = Spec("tide", "pbd", "h", 0.01)

    def key(spec=asked):
        run_key.forget()
        return run_key.key_of(spec, run_key.parts_of(spec, case))

    base = key()
    for change in (
        {"asked": 0.02},
        {"solver": "pbd[sweeps=2]"},
        {"start_seed": 1},
        {"case": "tide[a=1]"},
    ):
        assert key(dataclasses.replace(asked, **change)) != base
    assert (
        key(dataclasses.replace(asked, file="elsewhere.py")) == base
    )  # the case itself is what counts
    for name, value in (
        ("JAX_ENABLE_X64", "0"),
        ("NUMBA_CPU_NAME", "generic"),
        ("NPY_DISABLE_CPU_FEATURES", "AVX2"),
        ("NSBENCH_ANYTHING", "1"),
        ("LD_PRELOAD", ""),
    ):
        with monkeypatch.context() as m:
            m.setenv(name, value)
            assert key() != base
    for name in (
        "NUMBA_CACHE_DIR",
        "JAX_COMPILATION_CACHE_DIR",
        "OMP_NUM_THREADS",
        "NSBENCH_CACHE",
        "KMP_DUPLICATE_LIB_OK",
        "EDITOR",
    ):
        with monkeypatch.context() as m:
            m.setenv(name, "7")
            assert key() == base
    known = run_key.version
    for library in ("numpy", "llvmlite", "osqp"):
        with monkeypatch.context() as m:
            m.setattr(
                run_key, "version", lambda n, library=library: "0" if n == library else known(n)
            )
            assert key() != base
    assert key() == base


EDITED = """
import numpy as np
from nsbench import Affine, Case, Complementarity
from helper_of_edits import FACTOR
drift = lambda xp: lambda t, x: -1.0 * FACTOR * x
CASE = Case(name="edited", problem=Complementarity(drift, ()), x0=[1.0], t=np.linspace(0.0, 1.0, 5))
"""


def test_keys_have_the_form_of_those_in_stored_results():
    """Others would make every run again."""
    spec = Spec("tide", "pbd", "h", 0.1)
    parts = run_key.parts_of(spec, get_case("tide"))
    assert [len(part.digest) for part in parts] == [16, 16, 16]
    assert [len(run_key.key_of(spec, parts)), len(run_key.variable_digest("on"))] == [64, 16]


@pytest.mark.survives("stale")
def test_a_file_edited_within_a_second_runs_as_it_is_now(tmp_path, monkeypatch):
    """Byte code is known by the second and the size of its source, and both are as before."""
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    monkeypatch.syspath_prepend(tmp_path)
    file, helper = tmp_path / "edited.py", tmp_path / "helper_of_edits.py"
    helper.write_text("FACTOR = 1.0")
    drifts = []
    for factor in ("1.0", "2.0"):
        file.write_text(EDITED.replace("1.0 * FACTOR", f"{factor} * FACTOR"))
        os.utime(file, (1e9, 1e9))
        case = nsbench.load_case(file)
        drifts.append(float(case.problem.drift(np)(0.0, np.ones(1))[0]))
    assert drifts == [-1.0, -2.0]
    assert not (tmp_path / "__pycache__").exists()


def test_plugins_of_jax_are_part_of_a_key_and_a_distribution_without_a_name_is_none(monkeypatch):
    class Distribution:
        version = "0.4"

        def __init__(self, name):
            self.name = name

    found = [Distribution(n) for n in (None, "jax-cuda12-plugin", "jaxlib")]
    monkeypatch.setattr(run_key.metadata, "distributions", lambda path: found)
    assert run_key._accelerator.__wrapped__()["accelerator"].startswith("jax-cuda12-plugin 0.4")
    monkeypatch.setattr(run_key.metadata, "distributions", lambda path: found[::2])
    assert run_key._accelerator.__wrapped__() == {}
