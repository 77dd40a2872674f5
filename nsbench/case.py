"""A case: a problem with its start, its sample times and what is known of its solution."""
from __future__ import annotations

import dataclasses
import difflib
import functools
import importlib
import importlib.util
import inspect
import pkgutil
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from nsbench.problem import LCS, Complementarity, Distance, Filippov, _floats

STARTS = ("error", "project", "keep")


@dataclass(frozen=True, eq=False)
class Case:
    """A problem with its data; frozen.

    name; problem; x0 (n,); t (k,) sample times, t[0] the start and t[-1] = T.
    exact(t) -> (k, n) and exact_impulse(t) -> (k, m) where a closed form exists, the columns of the impulse being
    `contacts` (by default the rows of the families in order, all pairs excepted); exact_events: known event times.
    start: what an infeasible x0 means: "error", "project" (the nearest feasible point) or "keep".
    unique: False where the solution itself is not unique (repulsive sliding): no reference is allowed.
    distance(t, x) -> float, only there: how far the samples x (k, n) at t (k,) are from the set of all solutions, the
    least, over all of them, of the largest difference at any sample.
    substeps: fewest steps between two samples in the ladder of fixed-step methods.
    also: further solvers of the standard suite, such as "pbd[order=reverse]"; params: how the case was made.
    tags: free words for filters; radius: for pictures of particles.
    """
    name: str
    problem: Any
    x0: Any
    t: Any
    exact: Callable | None = None
    exact_impulse: Callable | None = None
    exact_events: Any = None
    contacts: tuple | None = None
    start: str = "error"
    unique: bool = True
    distance: Callable | None = None
    substeps: int = 2
    also: tuple[str, ...] = ()
    tags: tuple[str, ...] = ()
    params: dict = field(default_factory=dict)
    radius: float | None = None
    doc: str = ""
    source: str = ""

    def __post_init__(self):
        if not re.fullmatch(r"[A-Za-z0-9_.-]{1,80}", self.name):
            raise ValueError(f"case name {self.name!r}: letters, digits, '_', '.', '-', at most 80")
        if not isinstance(self.problem, (Complementarity, Filippov, LCS)):
            raise TypeError(f"problem of {self.name} is {type(self.problem).__name__}; "
                            "Complementarity, Filippov or LCS is needed")
        object.__setattr__(self, "x0", _floats("x0", self.x0, 1))
        t = _floats("t", self.t, 1)
        if len(t) < 2 or np.any(np.diff(t) <= 0):
            raise ValueError(f"t of {self.name} must increase and hold at least two times")
        object.__setattr__(self, "t", t)
        if self.start not in STARTS:
            raise ValueError(f"start is {self.start!r}; one of {STARTS}")
        if self.unique and self.distance is not None:
            raise ValueError(f"{self.name} gives the distance to a set of solutions, but says that there is one: unique=False?")
        check_shapes(self)

    @property
    def n(self) -> int:
        return self.x0.size

    @property
    def key(self) -> str:
        """Name with its parameters, as typed: ``discs[n=30,seed=0]``."""
        inner = ",".join(f"{k}={format_value(v)}" for k, v in self.params.items())
        return f"{self.name}[{inner}]" if inner else self.name

    @property
    def classes(self) -> tuple[str, ...]:
        """Words by which methods say what they expect: the kind of problem, what follows from the data, the tags."""
        kind = type(self.problem).__name__.lower()
        words = [kind, *self.tags]
        if kind == "complementarity" and not self.problem.constraints:
            words.append("smooth")
        if not self.unique:
            words.append("not_unique")
        return tuple(dict.fromkeys(words))

    def replace(self, **changes) -> Case:
        """The same case with some fields changed."""
        return dataclasses.replace(self, **changes)


def check_shapes(case: Case) -> None:
    """Evaluate the data once at the start; ValueError or TypeError names what is wrong."""
    p, x, t0 = case.problem, case.x0.copy(), float(case.t[0])
    if isinstance(p, LCS):
        _check_inputs(case)
        return
    with np.errstate(all="ignore"):
        if isinstance(p, Filippov):
            c = np.asarray(p.switch(np)(t0, x))
            if c.ndim != 1 or c.dtype != np.float64:
                raise ValueError(f"switch of {case.name} returns {c.dtype} of shape {c.shape}; float64 (d,) is needed")
            f = np.asarray(p.field(np)(t0, x, np.ones(len(c))))
        else:
            for c in p.constraints:
                if isinstance(c, Distance):
                    c.particles(case.n)
                elif hasattr(c, "shape") and c.shape[1] != case.n:
                    raise ValueError(f"A of {case.name} has {c.shape[1]} columns, the state {case.n} entries")
            f = np.asarray(p.drift(np)(t0, x))
    if f.shape != x.shape or f.dtype != np.float64:
        raise ValueError(f"drift of {case.name} returns {f.dtype} of shape {f.shape}; float64 {x.shape} is needed")
    if not np.array_equal(x, case.x0):
        raise ValueError(f"drift of {case.name} changes x in place")


def _check_inputs(case: Case) -> None:
    """The inputs of a linear complementarity system at the start."""
    p, t0 = case.problem, float(case.t[0])
    if p.A.shape[0] != case.n:
        raise ValueError(f"A of {case.name} has {p.A.shape[0]} rows, the state {case.n} entries")
    for name, factory, size in (("u", p.u, case.n), ("q", p.q, p.B.shape[1])):
        if factory is None:
            continue
        with np.errstate(all="ignore"):
            value = np.asarray(factory(np)(t0))
        if value.shape != (size,) or value.dtype != np.float64:
            raise ValueError(f"{name} of {case.name} returns {value.dtype} of shape {value.shape}; float64 ({size},) is needed")


def format_value(v) -> str:
    return "true" if v is True else "false" if v is False else f"{v:g}" if isinstance(v, float) else str(v)


def parse_spec(spec: str) -> tuple[str, dict]:
    """``name[a=1,b=x]`` -> name and parameters; values become bool, int, float or stay text."""
    m = re.fullmatch(r"\s*([^\[\]=,]+?)\s*(?:\[(.*)\])?\s*", spec)
    if not m:
        raise ValueError(f"cannot read {spec[:200]!r}; write name or name[key=value,...]")
    params = {}
    for part in filter(None, (s.strip() for s in (m[2] or "").split(","))):
        key, eq, text = part.partition("=")
        if not eq or key.strip() in params:
            raise ValueError(f"cannot read {part!r} in {spec[:200]!r}; write key=value, each key once")
        params[key.strip()] = parse_value(text.strip())
    return m[1], params


def parse_value(text: str):
    low = text.lower()
    if low in ("true", "false"):
        return low == "true"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def nearest(word: str, words) -> str:
    """" Did you mean X?" or the list of what exists, to end an error message with."""
    words = sorted(words)
    close = difflib.get_close_matches(word, words, 1, 0.5)
    return f"did you mean {close[0]!r}?" if close else f"there are: {', '.join(words)}"


@functools.cache
def _scan() -> tuple[dict, dict]:
    """Modules of nsbench.cases by name, and why those that failed to load did."""
    import nsbench.cases as package
    found, failed = {}, {}
    for info in pkgutil.iter_modules(package.__path__):
        try:
            found[info.name] = importlib.import_module(f"nsbench.cases.{info.name}")
        except Exception as e:                       # a broken plugin must not take the others with it
            failed[info.name] = f"{type(e).__name__}: {e}"
    return found, failed


def case_names() -> list[str]:
    return sorted(_scan()[0])


def broken_cases() -> dict[str, str]:
    return dict(_scan()[1])


def case_module(name: str):
    found, failed = _scan()
    if name in failed:
        raise ValueError(f"case {name!r} failed to load: {failed[name]}")
    if name not in found:
        raise LookupError(f"no case {name[:80]!r}; {nearest(name, found)}")
    return found[name]


def _build(module, name: str, params: dict) -> Case:
    if hasattr(module, "make"):
        known = inspect.signature(module.make).parameters
        for p in params:
            if p not in known:
                raise LookupError(f"case {name} has no parameter {p!r}; {nearest(p, known)}")
        try:
            case = module.make(**params)
        except (ValueError, TypeError, ArithmeticError, LookupError) as e:
            raise ValueError(f"case {name} cannot be made with {params}: {e}") from e
        if not isinstance(case, Case):
            raise ValueError(f"make(**params) of {name} returns {type(case).__name__}; a Case is needed")
        defaults = {k: v.default for k, v in known.items() if v.default is not inspect.Parameter.empty}
        params = {k: v for k, v in {**defaults, **params}.items() if params.get(k, defaults.get(k)) != defaults.get(k)
                  or k in getattr(module, "SHOWN", ())}
    elif params:
        raise LookupError(f"case {name} takes no parameters, got {sorted(params)}")
    else:
        case = module.CASE
        if not isinstance(case, Case):
            raise ValueError(f"CASE of {name} is {type(case).__name__}; a Case is needed")
    return case.replace(params=params, doc=case.doc or inspect.getdoc(module) or "",
                        source=getattr(module, "__file__", ""))


def get_case(name: str, **params) -> Case:
    """A registered case, ``get_case("discs", n=30, seed=0)`` or ``get_case("discs[n=30,seed=0]")``.

    LookupError for an unknown name or parameter (with the nearest match); ValueError for bad data.
    """
    base, inner = parse_spec(name)
    return _build(case_module(base), base, {**inner, **params})


def load_module(path):
    """Run the case or solver file at `path` as a module of its own."""
    path = Path(path).resolve()
    if not path.is_file():
        raise FileNotFoundError(f"no file {path}")
    spec = importlib.util.spec_from_file_location(f"nsbench_file_{path.stem}", path)
    module = sys.modules[spec.name] = importlib.util.module_from_spec(spec)      # dataclasses look themselves up there
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as e:             # the file is the user's: whatever it raises is told with its name
        raise ValueError(f"{path} failed to load: {type(e).__name__}: {e}") from e
    return module


def load_case(path, **params) -> Case:
    """The case of a file anywhere that defines ``CASE`` or ``make(**params)``."""
    module = load_module(path)
    if not (hasattr(module, "CASE") or hasattr(module, "make")):
        raise ValueError(f"{path} defines neither CASE nor make(**params)")
    return _build(module, Path(path).stem, params)
