"""Solvers, found by scanning this folder: a module that defines SOLVER is a method."""
from __future__ import annotations

import dataclasses
import functools
import importlib
import pkgutil
import sys

from nsbench.case import Case, format_value, get_case, load_module, nearest, parse_spec
from nsbench.solvers.base import Claims, Expect, Grid, Run, Solver, check_positive, grid, last_steps, sample
from nsbench.trajectory import Event, Status, Trajectory

__all__ = ["Case", "Claims", "Event", "Expect", "Grid", "Run", "Solver", "Status", "Trajectory", "all_names", "broken",
           "check_positive", "get", "grid", "last_steps", "load", "sample", "solve", "spec_of", "standard"]

_loaded: dict[str, type] = {}


@functools.cache
def _scan() -> tuple[dict, dict]:
    found, failed = {}, {}
    for info in pkgutil.iter_modules(__path__):
        if info.name in ("base", "start") or info.name.startswith("_"):
            continue
        try:
            module = importlib.import_module(f"{__name__}.{info.name}")
            found[info.name] = module.SOLVER
        except Exception as e:                       # a broken plugin must not take the others with it
            failed[info.name] = f"{type(e).__name__}: {e}"
    return found, failed


def load(path) -> str:
    """Register the solver of the file at `path`, which defines SOLVER, under the file's name."""
    module = load_module(path)
    if not hasattr(module, "SOLVER"):
        raise ValueError(f"{path} does not define SOLVER")
    name = module.__name__.removeprefix("nsbench_file_")
    if name in _scan()[0]:
        raise ValueError(f"{path}: a solver named {name!r} exists already")
    _loaded[name] = module.SOLVER
    return name


def all_names() -> list[str]:
    return sorted({**_scan()[0], **_loaded})


def broken() -> dict[str, str]:
    return dict(_scan()[1])


def standard() -> list[str]:
    """Specs of the standard suite: what a solver's file lists in STANDARD, else the solver with its defaults."""
    out = []
    for name in all_names():
        home = sys.modules.get({**_scan()[0], **_loaded}[name].__module__)
        out += list(getattr(home, "STANDARD", (name,)))
    return out


def get(spec: str) -> Solver:
    """The solver of ``"pbd[order=reverse]"``. LookupError for an unknown name or option, ValueError for a bad value."""
    name, options = parse_spec(spec)
    classes = {**_scan()[0], **_loaded}
    if name in _scan()[1]:
        raise ValueError(f"solver {name!r} failed to load: {_scan()[1][name]}")
    if name not in classes:
        raise LookupError(f"no solver {name!r}; {nearest(name, classes)}")
    known = {f.name for f in dataclasses.fields(classes[name])}
    for key in options:
        if key not in known:
            raise LookupError(f"solver {name} has no option {key!r}; {nearest(key, known)}")
    return classes[name](**options)


def spec_of(solver: Solver, name: str) -> str:
    """The spec with only the options that differ from the defaults."""
    parts = [f"{f.name}={format_value(getattr(solver, f.name))}" for f in dataclasses.fields(solver)
             if getattr(solver, f.name) != f.default]
    return f"{name}[{','.join(parts)}]" if parts else name


def solve(case: Case | str, solver: str = "event_driven", **accuracy) -> Trajectory:
    """One run: ``solve(case, "pbd[order=reverse]", h=1e-3)``.

    The accuracy parameter is the solver's own (h, tol, k); without it the solver's default is taken.
    A refusal is a Trajectory of no samples with the status "refused". Bad input raises.
    """
    case = get_case(case) if isinstance(case, str) else case
    method = get(solver)
    if set(accuracy) - {method.accuracy}:
        wrong = (set(accuracy) - {method.accuracy}).pop()
        raise LookupError(f"{solver} takes {method.accuracy!r}, not {wrong!r}")
    value = check_positive(method.accuracy, accuracy.get(method.accuracy, method.default))
    why = method.refuses(case)
    if why:
        return refused(case, why)
    return method.prepare(case, value)()


def refused(case: Case, why: str) -> Trajectory:
    import numpy as np
    none = np.empty((0, 0))
    return Trajectory(np.empty(0), np.empty((0, case.n)), (), none, np.empty((0, case.n)), Status("refused", why))
