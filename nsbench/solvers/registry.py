"""Registry of solvers, and one run of one of them.

A file or folder beside this one that defines SOLVER is a method; so is a file that a user loads.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib
import pkgutil
import re
import sys
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from nsbench import input_errors, user_code
from nsbench.case import Case, case_module, format_value, get_case, load_module, nearest, parse_spec
from nsbench.compilation.announcement import announced_compilation
from nsbench.solvers.base import Solver, check_positive, default_accuracy
from nsbench.solvers.common.prepared_runs import PreparedRuns
from nsbench.source_files import plugins
from nsbench.trajectory import Status, Trajectory

if TYPE_CHECKING:
    from nsbench.solvers.scaled_run import ScaledRun

_loaded: dict[str, type] = {}
_prepared = PreparedRuns()
NAME = re.compile(r"[A-Za-z0-9_.-]{1,80}")  # of a solver, as of a case
PACKAGE = "nsbench.solvers"
NOT_METHODS = ("base", "common", "registry", "scaled_run")


@functools.cache
def _scan() -> tuple[dict, dict]:
    """Return the methods of this folder by name, and why the others failed to load."""
    found = {}
    failed = {}
    for info in pkgutil.iter_modules(sys.modules[PACKAGE].__path__):
        if info.name in NOT_METHODS or info.name.startswith("_"):
            continue
        try:
            with user_code.guarded(f"the file of the solver {info.name}"):
                module = importlib.import_module(f"{PACKAGE}.{info.name}")
            found[info.name] = _checked(module)
        except (Exception, SystemExit) as e:  # a broken plugin must not take the others with it
            home = Path(info.module_finder.path) / info.name
            file = home / "method.py" if info.ispkg else home.with_suffix(".py")
            failed[info.name] = input_errors.describe(e, file)
    return found, failed


def _checked(module) -> type:
    """Return SOLVER of a module; TypeError with what is missing if it is no solver."""
    made = getattr(module, "SOLVER", None)
    if made is None:
        raise TypeError(
            f"{module.__file__} does not define SOLVER; end it with `SOLVER = ...`, the class of "
            f"the method"
        )
    if not (isinstance(made, type) and dataclasses.is_dataclass(made)):
        raise TypeError(
            f"SOLVER of {module.__file__} is {made!r:.80}; a frozen dataclass is needed: "
            f"`@dataclass(frozen=True)` above the class, and SOLVER is the class, not an instance"
        )
    missing = [
        n for n in ("accuracy", "default", "claims", "refuses", "prepare") if not hasattr(made, n)
    ]
    if missing:
        raise TypeError(f"SOLVER of {module.__file__} has no {', '.join(missing)}")
    bare = [
        f.name
        for f in dataclasses.fields(made)
        if f.init and f.default is f.default_factory is dataclasses.MISSING
    ]
    if bare:
        raise TypeError(
            f"SOLVER of {module.__file__} has no default of {', '.join(bare)}; every option needs "
            f"one"
        )
    return made


def load(path: str | Path) -> str:
    """Register the solver of the file at `path`, which defines SOLVER, and return its name.

    It is named after the file. Raises ValueError for a name that is taken or not allowed, TypeError
    if SOLVER is no solver.
    """
    path = Path(path).resolve()
    name = path.stem
    if not NAME.fullmatch(name):
        raise ValueError(
            f"{str(path)!r}: a solver is named after its file, in letters, digits, '_', '.', '-', "
            f"at most 80"
        )
    homes = {
        n: sys.modules[c.__module__].__file__
        for n, c in {**_scan()[0], **_loaded}.items()
        if c.__module__ in sys.modules
    }
    for other, file in homes.items():
        if other.casefold() == name.casefold() and not (other in _loaded and Path(file) == path):
            raise ValueError(f"{path}: a solver named {other!r} exists already, in {file}")
    _loaded[name] = _checked(load_module(path))
    return name


def all_names() -> list[str]:
    """Return the names of all solvers, sorted."""
    return sorted({**_scan()[0], **_loaded})


def broken() -> dict[str, str]:
    """Return why the methods of this folder that failed to load did, by name."""
    return dict(_scan()[1])


def plugin_files(specs: Iterable[str]) -> list[str]:
    """Return the files of those methods of `specs` that installed packages bring.

    Raises ValueError with the reason for one that cannot be found.
    """
    known = {**_scan()[0], **_scan()[1], **_loaded}
    names = dict.fromkeys(parse_spec(spec)[0] for spec in specs)
    brought = plugins.plugin_names(plugins.SOLVERS)
    return [
        str(plugins.plugin_file(plugins.SOLVERS, name))
        for name in names
        if name in brought and name not in known
    ]


def broken_plugins() -> dict[str, str]:
    """Load the methods of all plugins; return why those that cannot be used failed, by name."""
    failed = {}
    for name in plugins.plugin_names(plugins.SOLVERS):
        if name in _scan()[0]:
            failed[name] = "a method of nsbench bears this name"
            continue
        try:
            get(name)
        except (LookupError, ValueError, TypeError, FileNotFoundError) as e:
            failed[name] = str(e)
    return failed


def standard() -> list[str]:
    """Return the specs of the standard suite.

    They are those that a solver's file lists in STANDARD, else the solver with its defaults.
    """
    out = []
    own = {**_scan()[0], **_loaded}
    # what an installed package brings runs by name: the suite is the same whatever is installed
    brought = [n for n in _loaded if n in plugins.plugin_names(plugins.SOLVERS)]
    for name in sorted(set(own) - set(brought)):
        home = sys.modules.get(own[name].__module__)
        out += list(getattr(home, "STANDARD", (name,)))
    return out


def get(spec: str) -> Solver:
    """Return the solver of a spec such as ``"pbd[order=reverse]"``.

    Raises LookupError for an unknown name or option, ValueError for a bad value.
    """
    name, options = parse_spec(spec)
    classes = {**_scan()[0], **_loaded}
    if name in _scan()[1]:
        raise ValueError(f"solver {name!r} failed to load: {_scan()[1][name]}")
    if name not in classes and (files := plugin_files([name])):
        load(files[0])
        classes = {**classes, **_loaded}
    if name not in classes:
        known = [*classes, *plugins.plugin_names(plugins.SOLVERS)]
        of_file = "one of your own: --solvers FILE, in Python nsbench.solvers.load(FILE)"
        raise LookupError(f"no solver {name!r}; {nearest(name, known)}; {of_file}")
    known = {f.name for f in dataclasses.fields(classes[name])}
    for key in options:
        if key not in known:
            raise LookupError(f"solver {name} has no option {key!r}; {nearest(key, known)}")
    return classes[name](**options)


def spec_of(solver: Solver, name: str) -> str:
    """Return the spec with only the options that differ from the defaults."""
    parts = [
        f"{f.name}={format_value(getattr(solver, f.name))}"
        for f in dataclasses.fields(solver)
        if getattr(solver, f.name) != f.default
    ]
    return f"{name}[{','.join(parts)}]" if parts else name


def solve(case: Case | str, solver: str = "event_driven", **accuracy: float) -> Trajectory:
    """Run one solver on one case: ``solve(case, "pbd[order=reverse]", h=1e-3)``.

    case: a case or the spec of one. accuracy: the solver's own parameter (h, tol, k), else its
    default is taken. What was prepared for the same case, options and accuracy is used again. The
    first call of a method compiles it, and says so to a terminal or a notebook.
    Returns the trajectory, checked by nsbench.diagnostics; a refusal is a trajectory without
    samples and with the status "refused". Raises LookupError or ValueError for bad input,
    TypeError for a method that returns no trajectory, or one of other shapes.
    """
    from nsbench.solvers.common.returned_value import returned_violation

    case = _registered_case(case, _module_of(case)) if isinstance(case, str) else case
    is_kept = _is_of_package(parse_spec(solver)[0])
    key = (case, solver, *((name, repr(value)) for name, value in accuracy.items()))
    run = _prepared.take(key) if is_kept else None
    with announced_compilation(solver):
        if run is None:
            run = _prepare(case, solver, accuracy)
            if isinstance(run, Trajectory):
                return run
        found = run()
    known = run.known_checks(found) if isinstance(found, Trajectory) else None
    converted = run.to_user_units(found)
    if known is None and (wrong := returned_violation(case, converted)):
        raise TypeError(f"{solver} on {case.key}: {wrong}")
    checked = run.add_status_and_bars(found, converted, known)
    if is_kept:
        _prepared.put(key, case.n * len(case.t), run)
    return checked


def _prepare(case: Case, solver: str, accuracy: dict) -> ScaledRun | Trajectory:
    """Prepare a run, or return the trajectory of a refusal."""
    from nsbench.solvers.scaled_run import ScaledRun

    method = get(solver)
    if set(accuracy) - {method.accuracy}:
        wrong = (set(accuracy) - {method.accuracy}).pop()
        raise LookupError(f"{solver} takes {method.accuracy!r}, not {wrong!r}")
    value = check_positive(method.accuracy, accuracy.get(method.accuracy, 1.0))
    why = method.refuses(case)
    if why:
        return refused(case, why)
    return ScaledRun(method, case, value if accuracy else default_accuracy(method, case))


def _is_of_package(name: str) -> bool:
    """Is the method one of the package, whose runs keep no state from one call to the next?"""
    return name in _scan()[0] and name not in _loaded


def _module_of(spec: str) -> ModuleType:
    return case_module(parse_spec(spec)[0])


@functools.lru_cache(maxsize=64)
def _registered_case(spec: str, module: ModuleType) -> Case:
    """Build the case of a spec; the same object for the same spec, so that its runs are found.

    module: where it is defined; another one after the registry was read again.
    """
    return get_case(spec)


def refused(case: Case, why: str) -> Trajectory:
    """Return a trajectory without samples and with the status "refused"; why: the sentence."""
    import numpy as np

    none = np.empty((0, 0))
    return Trajectory(
        np.empty(0), np.empty((0, case.n)), (), none, np.empty((0, case.n)), Status("refused", why)
    )
