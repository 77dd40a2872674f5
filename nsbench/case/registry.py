"""Registry of cases: find, import and build the registered ones; load a case from any file."""

from __future__ import annotations

import contextlib
import functools
import importlib
import importlib.machinery
import importlib.util
import inspect
import pkgutil
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import CodeType, ModuleType

from nsbench import input_errors, user_code
from nsbench.case.definition import Case
from nsbench.case.spec import format_value, parse_spec
from nsbench.input_errors import nearest
from nsbench.source_files import opened_files, plugins

MAX_FILE_BYTES = 4 << 20  # a longer file was not written by hand


@functools.cache
def _scan() -> tuple[dict, dict]:
    """Import all modules of nsbench.cases: those found by name, and the reason for each failure."""
    import nsbench.cases as package

    found = {}
    failed = {}
    for info in pkgutil.iter_modules(package.__path__):
        try:
            with user_code.guarded(f"the file of the case {info.name}"):
                module = importlib.import_module(f"nsbench.cases.{info.name}")
        except (Exception, SystemExit) as e:  # a broken plugin must not take the others with it
            file = Path(getattr(info.module_finder, "path", "")) / f"{info.name}.py"
            failed[info.name] = input_errors.describe(e, file)
            continue
        if hasattr(module, "CASE") or hasattr(module, "make"):
            found[info.name] = module
        else:
            failed[info.name] = f"{module.__file__} defines neither CASE nor make(**params)"
    for one, other in equal_but_for_case({name: str(m.__file__) for name, m in found.items()}):
        for name in (one, other):
            failed[name] = (
                f"names that are equal but for case: {found[one].__file__} and "
                f"{found[other].__file__}"
            )
    return {name: m for name, m in found.items() if name not in failed}, failed


def equal_but_for_case(names: Iterable[str]) -> list[tuple[str, str]]:
    """List pairs of different names that differ in upper and lower case only.

    On case-insensitive file systems their files would be one.
    """
    first: dict[str, str] = {}
    return [
        (first[n.casefold()], n) for n in sorted(names) if first.setdefault(n.casefold(), n) != n
    ]


def case_names() -> list[str]:
    """List the names of all registered cases, sorted; those of plugins are not among them."""
    return sorted(_scan()[0])


def plugin_case_names() -> list[str]:
    """List the cases that installed packages bring, sorted, loadable or not."""
    return plugins.plugin_names(plugins.CASES)


def plugin_case_file(name: str) -> str:
    """Return the file of a case that an installed package brings; "" for any other name.

    Raises ValueError with the reason if the plugin has no such file.
    """
    own, failed = _scan()
    if name in own or name in failed or name not in plugin_case_names():
        return ""
    return str(plugins.plugin_file(plugins.CASES, name))


def broken_cases() -> dict[str, str]:
    """Return why each case file that could not be loaded failed, by name."""
    return dict(_scan()[1])


def case_module(name: str) -> ModuleType:
    """Return the module of a registered case.

    Raises LookupError for an unknown name (with the nearest one), ValueError if its file failed to
    load.
    """
    found, failed = _scan()
    if name in failed:
        raise ValueError(f"case {name!r} failed to load: {failed[name]}")
    if name not in found and name in plugin_case_names():
        return _plugin_module(name)
    if name not in found:
        if name.endswith(".py"):
            raise LookupError(f"no case {name[:80]!r}; of a file: nsbench.load_case({name[:80]!r})")
        known = [*found, *plugin_case_names()]
        raise LookupError(f"no case {name[:80]!r}; {nearest(name, known)}")
    return found[name]


@functools.cache
def _plugin_module(name: str) -> ModuleType:
    """Load the module of a plugin. Raises ValueError with the reason if it cannot be loaded."""
    try:
        module = load_module(plugins.plugin_file(plugins.CASES, name))
    except (ValueError, FileNotFoundError) as e:
        raise ValueError(f"case {name!r} failed to load: {e}") from e
    if not (hasattr(module, "CASE") or hasattr(module, "make")):
        raise ValueError(
            f"case {name!r} failed to load: {module.__file__} defines neither CASE nor "
            "make(**params)"
        )
    return module


def broken_plugin_cases() -> dict[str, str]:
    """Load the cases of all plugins; return why those that cannot be used failed, by name."""
    failed = {}
    for name in plugin_case_names():
        if name in _scan()[0]:
            failed[name] = "a case of nsbench bears this name"
            continue
        try:
            _plugin_module(name)
        except ValueError as e:
            failed[name] = str(e).partition("failed to load: ")[2]
    return failed


def _build(module: ModuleType, name: str, params: dict) -> Case:
    """Build the case of a module from ``make(**params)`` or ``CASE``.

    Its `params` are those that differ from their defaults, or that the module lists in SHOWN.
    """
    if hasattr(module, "make"):
        known = inspect.signature(module.make).parameters
        for p in params:
            if p not in known:
                raise LookupError(f"case {name} has no parameter {p!r}; {nearest(p, known)}")
        _check_numbers(name, params, known)
        try:
            case = module.make(**params)
        except (Exception, SystemExit) as e:  # user code: any failure is reported with its name
            why = input_errors.describe(e, str(module.__file__))
            raise ValueError(f"case {name} cannot be made with {params}: {why}") from e
        if not isinstance(case, Case):
            raise ValueError(
                f"make of {module.__file__} returns {type(case).__name__}; a Case is needed"
                + (": is its last line, `return Case(...)`, missing?" if case is None else "")
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
            raise ValueError(
                f"CASE of {module.__file__} is {type(case).__name__}; a Case is needed: "
                f"CASE = Case(name=..., problem=..., x0=..., t=...)"
            )
    return case.replace(
        params=params,
        doc=case.doc or inspect.getdoc(module) or "",
        source=getattr(module, "__file__", ""),
    )


def _check_numbers(name: str, params: dict, known: Mapping[str, inspect.Parameter]) -> None:
    """Raise ValueError for a text that is given for a parameter whose default is a number."""
    for key, value in params.items():
        default = known[key].default
        if isinstance(value, str) and isinstance(default, (int, float)):
            raise ValueError(
                f"parameter {key} of {name} is {value!r:.60}; a "
                f"{'truth value' if isinstance(default, bool) else 'number'} is needed, such as "
                f"{name}[{key}={format_value(default)}]"
            )


def get_case(name: str, **params: object) -> Case:
    """Build a registered case: ``get_case("discs", n=30)`` or ``get_case("discs[n=30]")``.

    Raises LookupError for an unknown name or parameter, with the nearest match; ValueError for bad
    data.
    """
    base, inner = parse_spec(name)
    with user_code.guarded(f"make of the case {base}"):
        case = _build(case_module(base), base, {**inner, **params})
    if case.name != base:  # its runs could not be told from those of another case
        raise ValueError(
            f"{case.source} makes a case named {case.name!r}; the file's name is {base!r}"
        )
    return case


class _FromSource(importlib.machinery.SourceFileLoader):
    """Compile a file's text whenever it is executed.

    Byte code is known by the second and the size of its source: a file that is edited twice in one
    second ran as it was before, under the digest of what it is.
    """

    def get_code(self, fullname: str) -> CodeType:
        return self.source_to_code(self.get_data(self.path), self.path)


@contextlib.contextmanager
def _without_byte_code() -> Iterator[None]:
    """Let modules that a user's file imports leave no byte code, for the same reason."""
    before = sys.dont_write_bytecode
    sys.dont_write_bytecode = True
    try:
        yield
    finally:
        sys.dont_write_bytecode = before


def load_module(path: str | Path) -> ModuleType:
    """Execute the case or solver file at `path` as a module of its own.

    Files that it opens meanwhile are recorded as data it depends on. Raises FileNotFoundError;
    ValueError if the file is too long or whatever it raised, with its path.
    """
    path = Path(path).resolve()
    if not path.is_file():
        raise FileNotFoundError(f"no file {path}")
    if path.stat().st_size > MAX_FILE_BYTES:
        raise ValueError(
            f"{path} is {path.stat().st_size} bytes long; a case or solver file has at most "
            f"{MAX_FILE_BYTES}"
        )
    if path.suffix != ".py":
        raise ValueError(f"{path} is no Python file: its name must end in .py")
    name = f"nsbench_file_{path.stem}"
    loader = _FromSource(name, str(path))
    spec = importlib.machinery.ModuleSpec(name, loader, origin=str(path))
    spec.has_location = True
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look themselves up there
    try:
        with (
            opened_files.record_opens_while_loading(path),
            user_code.guarded(str(path)),
            user_code.loading(path),
            _without_byte_code(),
        ):
            loader.exec_module(module)
    except (Exception, SystemExit) as e:  # user code: any failure is reported with its path
        raise ValueError(input_errors.describe(e, path)) from e
    return module


def load_case(path: str | Path, **params: object) -> Case:
    """Build the case of any file that defines ``CASE`` or ``make(**params)``.

    Raises FileNotFoundError, LookupError for an unknown parameter, ValueError for bad data.
    """
    module = load_module(path)
    if not (hasattr(module, "CASE") or hasattr(module, "make")):
        raise ValueError(f"{path} defines neither CASE = Case(...) nor make(**params)")
    with (
        opened_files.record_opens_while_loading(path),
        user_code.guarded(f"make of {path}"),
        user_code.loading(path),
    ):
        return _build(module, Path(path).stem, params)
