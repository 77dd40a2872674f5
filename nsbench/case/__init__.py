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

from nsbench import user_code
from nsbench.case.validation import check_shapes
from nsbench.problem import LCS, Complementarity, Filippov, _floats
from nsbench.source_files import opened_files

STARTS = ("error", "project", "keep")
ENOUGH = 4 << 20  # bytes: a longer file was not written by hand


@dataclass(frozen=True, eq=False)
class Case:
    """A problem with its data; frozen.

    name; problem; x0 (n,); t (k,) sample times, t[0] the start and t[-1] = T.
    exact(t) -> (k, n) and exact_impulse(t) -> (k, m) where a closed form exists, the columns of the
    impulse being `contacts` (by default the rows of the families in order, all pairs excepted);
    exact_events: known event times.
    start: what an infeasible x0 means: "error", "project" (the nearest feasible point) or "keep".
    unique: False where the solution itself is not unique (repulsive sliding): no reference is
    allowed.
    distance(t, x) -> float, only there: how far the samples x (k, n) at t (k,) are from the set of
    all solutions, the least, over all of them, of the largest difference at any sample.
    substeps: fewest steps between two samples in the ladder of fixed-step methods.
    also: further solvers of the standard suite, such as "pbd[order=reverse]"; params: how the case
    was made.
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
        if not (isinstance(self.name, str) and re.fullmatch(r"[A-Za-z0-9_.-]{1,80}", self.name)):
            raise ValueError(
                f"case name {str(self.name)[:100]!r}: letters, digits, '_', '.', '-', at most 80"
            )
        if not isinstance(self.problem, (Complementarity, Filippov, LCS)):
            raise TypeError(
                f"problem of {self.name} is {type(self.problem).__name__}; "
                "Complementarity, Filippov or LCS is needed"
            )
        object.__setattr__(self, "x0", _floats("x0", self.x0, 1))
        if not self.x0.size:
            raise ValueError(f"x0 of {self.name} is empty; a state has at least one coordinate")
        t = _floats("t", self.t, 1)
        if len(t) < 2 or np.any(np.diff(t) <= 0):
            where = int(np.argmax(np.diff(t) <= 0)) if len(t) > 1 else 0
            raise ValueError(
                f"t of {self.name} must increase and hold at least two times; it is "
                f"{', '.join(f'{v:g}' for v in t[where : where + 2])} there"
            )
        object.__setattr__(self, "t", t)
        if self.start not in STARTS:
            raise ValueError(f"start is {self.start!r}; one of {STARTS}")
        if self.unique and self.distance is not None:
            raise ValueError(
                f"{self.name} gives the distance to a set of solutions, but says that there is "
                f"one: unique=False?"
            )
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
        """Words by which methods say what they expect: the kind of problem, what follows from the
        data, the tags."""
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


def format_value(v) -> str:
    return (
        "true"
        if v is True
        else "false"
        if v is False
        else f"{v:g}"
        if isinstance(v, float)
        else str(v)
    )


def parse_spec(spec: str) -> tuple[str, dict]:
    """``name[a=1,b=x]`` -> name and parameters; values become bool, int, float or stay text."""
    m = re.fullmatch(r"\s*([^\[\]=,]+?)\s*(?:\[(.*)\])?\s*", spec)
    if not m:
        raise ValueError(f"cannot read {spec[:200]!r}; write name or name[key=value,...]")
    params = {}
    for part in filter(None, (s.strip() for s in (m[2] or "").split(","))):
        key, eq, text = part.partition("=")
        if not eq or key.strip() in params:
            raise ValueError(
                f"cannot read {part!r} in {spec[:200]!r}; write key=value, each key once"
            )
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
    """ " Did you mean X?" or the list of what exists, to end an error message with."""
    words = sorted(words)
    close = difflib.get_close_matches(word, words, 1, 0.5)
    return f"did you mean {close[0]!r}?" if close else f"there are: {', '.join(words)}"


@functools.cache
def _scan() -> tuple[dict, dict]:
    """Modules of nsbench.cases by name, and why those that failed to load did."""
    import nsbench.cases as package

    found = {}
    failed = {}
    for info in pkgutil.iter_modules(package.__path__):
        try:
            with user_code.guarded(f"the file of the case {info.name}"):
                module = importlib.import_module(f"nsbench.cases.{info.name}")
        except (Exception, SystemExit) as e:  # a broken plugin must not take the others with it
            failed[info.name] = f"{type(e).__name__}: {e}"
            continue
        if hasattr(module, "CASE") or hasattr(module, "make"):
            found[info.name] = module
        else:
            failed[info.name] = f"{module.__file__} defines neither CASE nor make(**params)"
    for one, other in alike({name: str(m.__file__) for name, m in found.items()}):
        for name in (one, other):
            failed[name] = (
                f"names that are equal but for case: {found[one].__file__} and "
                f"{found[other].__file__}"
            )
    return {name: m for name, m in found.items() if name not in failed}, failed


def alike(names) -> list[tuple[str, str]]:
    """Pairs of different names that are equal but for case: on some machines their files are
    one."""
    seen: dict[str, str] = {}
    return [(seen[n.casefold()], n) for n in sorted(names) if seen.setdefault(n.casefold(), n) != n]


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
        except (
            Exception,
            SystemExit,
        ) as e:  # the file is somebody's: whatever it raises is told with its name
            raise ValueError(f"case {name} cannot be made with {params}: {_told(e)}") from e
        if not isinstance(case, Case):
            raise ValueError(
                f"make(**params) of {name} returns {type(case).__name__}; a Case is needed"
            )
        defaults = {
            k: v.default for k, v in known.items() if v.default is not inspect.Parameter.empty
        }
        params = {
            k: v
            for k, v in {**defaults, **params}.items()
            if params.get(k, defaults.get(k)) != defaults.get(k)
            or k in getattr(module, "SHOWN", ())
        }
    elif params:
        raise LookupError(f"case {name} takes no parameters, got {sorted(params)}")
    else:
        case = module.CASE
        if not isinstance(case, Case):
            raise ValueError(f"CASE of {name} is {type(case).__name__}; a Case is needed")
    return case.replace(
        params=params,
        doc=case.doc or inspect.getdoc(module) or "",
        source=getattr(module, "__file__", ""),
    )


def _told(e: BaseException) -> str:
    usual = isinstance(e, (ValueError, TypeError, ArithmeticError, LookupError))
    return str(e) if usual else f"{type(e).__name__}: {e}"


def get_case(name: str, **params) -> Case:
    """A registered case, ``get_case("discs", n=30, seed=0)`` or ``get_case("discs[n=30,seed=0]")``.

    LookupError for an unknown name or parameter (with the nearest match); ValueError for bad data.
    """
    base, inner = parse_spec(name)
    with user_code.guarded(f"make of the case {base}"):
        case = _build(case_module(base), base, {**inner, **params})
    if case.name != base:  # its runs could not be told from those of another case
        raise ValueError(
            f"{case.source} makes a case named {case.name!r}; the file's name is {base!r}"
        )
    return case


def load_module(path):
    """Run the case or solver file at `path` as a module of its own."""
    path = Path(path).resolve()
    if not path.is_file():
        raise FileNotFoundError(f"no file {path}")
    if path.stat().st_size > ENOUGH:
        raise ValueError(
            f"{path} is {path.stat().st_size} bytes long; a case or solver file has at most "
            f"{ENOUGH}"
        )
    spec = importlib.util.spec_from_file_location(f"nsbench_file_{path.stem}", path)
    module = sys.modules[spec.name] = importlib.util.module_from_spec(
        spec
    )  # dataclasses look themselves up there
    try:
        with opened_files.record_opens_while_loading(path), user_code.guarded(str(path)):
            spec.loader.exec_module(module)
    except (
        Exception,
        SystemExit,
    ) as e:  # the file is the user's: whatever it raises is told with its name
        raise ValueError(f"{path} failed to load: {type(e).__name__}: {e}") from e
    return module


def load_case(path, **params) -> Case:
    """The case of a file anywhere that defines ``CASE`` or ``make(**params)``."""
    module = load_module(path)
    if not (hasattr(module, "CASE") or hasattr(module, "make")):
        raise ValueError(f"{path} defines neither CASE nor make(**params)")
    with opened_files.record_opens_while_loading(path), user_code.guarded(f"make of {path}"):
        return _build(module, Path(path).stem, params)
