"""By which a run is found again: everything that can change its numbers, in parts that can be told
apart.

A key is the digest of what was asked for (case, solver, accuracy, nudge) and of three parts, each a
list of items: what every run depends on (the files that run and measure, the machine), what its
solver does, what its case does. An item is a file with the digest of its content, a library with
its version, a setting with its value. Which files count is read off the imports
(nsbench.source_files.import_graph); editing one file makes those runs again that depend on it, and
no other.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import platform
import re
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from nsbench.case import parse_spec
from nsbench.source_files import file_state, import_graph, locations, opened_files

ROOT = locations.ROOT
# From here every row comes; the last begins each run with the same global random numbers and
# rounding
COMMON = (
    "study/__init__.py",
    "measure/errors.py",
    "measure/clock.py",
    "execute/workers/process_state.py",
)
MACHINE = ("GLIBC_TUNABLES", "LD_PRELOAD", "LD_LIBRARY_PATH")
SETTINGS = {
    "numpy": ("NPY_", "OPENBLAS_", "MKL_", "BLIS_", "VECLIB_", "OMP_", "KMP_"),
    "numba": ("NUMBA_",),
    "jax": ("JAX_", "XLA_", "CUDA_", "HIP_", "ROCR_", "TF_XLA"),
}
NAMES = {
    "flint": "python-flint",
    "sklearn": "scikit-learn",
    "yaml": "PyYAML",
}  # where the import has another name
# Where things are kept, what is printed, and what workers set themselves, all to one thread
HARMLESS = re.compile(
    r".*(_CACHE_DIR|_NUM_THREADS|_TRACEBACK_FILTERING|_COLOR_SCHEME)$|JAX_PERSISTENT_CACHE_.*|NSBENCH_CACHE|"
    r"NUMBA_(DEBUG|DUMP|DEVELOPER|WARNINGS|TRACE|SHOW|FULL|HIGHLIGHT).*"
)


@dataclass(frozen=True)
class Part:
    """Items of one part by name; digest: sixteen hexadecimal digits of them all."""

    items: tuple[tuple[str, str], ...]
    digest: str

    @classmethod
    def of(cls, items: dict[str, str]) -> Part:
        pairs = tuple(sorted(items.items()))
        return cls(pairs, _digest(json.dumps(pairs).encode())[:16])


def key_of(spec, parts: tuple[Part, ...]) -> str:
    """Key of a run."""
    asked = [spec.case, spec.solver, spec.accuracy, repr(float(spec.asked)), spec.nudge]
    return _digest(json.dumps([asked, [p.digest for p in parts]]).encode())


def parts_of(spec, case) -> tuple[Part, ...]:
    """What a run of the case depends on: the common part, that of its solver, that of its case."""
    return (
        _common(),
        _of_solver(spec.solver, spec.solver_files),
        _of_case(case.source, _references(case)),
    )


def dependency_files(spec, case) -> frozenset[str]:
    """Paths of all files that a run depends on: those that are imported or opened, stored
    references, whether they are there or not, and what tells the versions of libraries."""
    from nsbench.reference.storage import files_of

    return _watched(
        spec.solver, spec.solver_files, case.source, tuple(str(f) for f in files_of(case))
    )


def user_files(*paths: str) -> list[str]:
    """All files that case or solver files depend on and that neither this package nor a library
    brings, themselves included."""
    return sorted(p for p in _with_data(*paths).files if locations.is_user_file(p))


@functools.cache
def _watched(
    solver: str, solver_files: tuple[str, ...], source: str, references: tuple[str, ...]
) -> frozenset[str]:
    found = _common_needs(), _solver_needs(solver, solver_files), _case_needs(source)
    told = map(_told_by, _with_transitive({name for f in found for name in f.libraries}))
    return frozenset({*references, *filter(None, told)}.union(*(f.files for f in found)))


def forget() -> None:
    """Files are read again from now on: for a process that outlives an edit."""
    import_graph.forget()
    file_state.forget()
    for f in (
        _common,
        _common_needs,
        _of_solver,
        _solver_needs,
        _of_case,
        _case_needs,
        _content,
        _watched,
    ):
        f.cache_clear()


@functools.cache
def _common_needs() -> import_graph.Dependencies:
    return import_graph.dependencies(*(ROOT / p for p in COMMON), *_with_side_effects())


@functools.cache
def _common() -> Part:
    found = _common_needs()
    items = (
        _files(found.files, ROOT)
        | _libraries(found.libraries)
        | {"python": platform.python_version()}
    )
    items |= {
        f"setting {k}": v
        for k, v in os.environ.items()
        if k in MACHINE or (k.startswith("NSBENCH_") and not HARMLESS.match(k))
    }
    return Part.of(items | {"processor": processor()})


@functools.cache
def _solver_needs(spec: str, solver_files: tuple[str, ...]) -> import_graph.Dependencies:
    """Of the solver's file, and of others that its options name."""
    name, options = parse_spec(spec)
    known = locations.plugin_files("solvers") | {Path(f).stem: f for f in solver_files}
    return _with_data(
        *dict.fromkeys(known[n] for n in (name, *map(str, options.values())) if n in known)
    )


@functools.cache
def _of_solver(spec: str, solver_files: tuple[str, ...]) -> Part:
    found = _solver_needs(spec, solver_files)
    return Part.of(_files(found.files, _home(spec, solver_files)) | _libraries(found.libraries))


def _home(spec, solver_files) -> Path:
    name = parse_spec(spec)[0]
    return next((Path(f).resolve().parent for f in solver_files if Path(f).stem == name), ROOT)


@functools.cache
def _case_needs(source: str) -> import_graph.Dependencies:
    return _with_data(*filter(None, [source]))


def _with_data(*paths: str) -> import_graph.Dependencies:
    """What files depend on, data included that they opened while they were loaded."""
    data = {
        p
        for path in paths
        for p in opened_files.opened_while_loading(path)
        if locations.is_user_file(p)
    }
    return import_graph.dependencies(*paths, *sorted(data))


@functools.cache
def _of_case(source: str, references: tuple[str, ...]) -> Part:
    found = _case_needs(source)
    return Part.of(
        _files({*found.files, *references}, Path(source).resolve().parent)
        | _libraries(found.libraries)
    )


def _references(case) -> tuple[str, ...]:
    from nsbench.reference.storage import files_of

    files = [str(f) for f in files_of(case)]
    for f in files:
        file_state.record_state(f)
    return tuple(f for f in files if os.path.exists(f))


def _files(paths, home: Path) -> dict[str, str]:
    """Digests by the path within the package, or from the folder of the case or solver file."""
    out = {}
    for path in paths:
        p = Path(path)
        inside = next(
            (
                f"{n.replace('.', '/')}/{p.relative_to(h).as_posix()}"
                for n, h in sorted(locations.package_folders().items(), reverse=True)
                if p.is_relative_to(h)
            ),
            "",
        )
        out[inside or Path(os.path.relpath(p, home)).as_posix()] = _content(path)
    return out


@functools.cache
def _content(path: str) -> str:
    file_state.record_state(path)
    return file_state.digest(path)


def _libraries(names) -> dict[str, str]:
    """Versions of libraries and of all they depend on, and the settings they look at."""
    out = {}
    for name in _with_transitive(names):
        out[name] = version(name)[0]
        if told := _told_by(name):
            file_state.record_state(told)
    settings = {
        f"setting {k}": v
        for k, v in os.environ.items()
        if not HARMLESS.match(k)
        and any(k.startswith(p) for lib, starts in SETTINGS.items() if lib in out for p in starts)
    }
    if "jax" in out:
        settings |= _accelerator()
    return out | settings


def _with_transitive(names) -> list[str]:
    """The libraries and all they depend on."""
    todo = sorted(names)
    out = []
    while todo:
        name = todo.pop()
        if name not in out:
            out.append(name)
            todo += version(name)[1]
    return out


@functools.cache
def version(name: str) -> tuple[str, tuple[str, ...]]:
    """Version of a library by the name of its import, and what it depends on itself (extras
    apart)."""
    try:
        found = metadata.distribution(NAMES.get(name, name))
    except (metadata.PackageNotFoundError, ValueError):
        return "not installed", ()
    needed = [re.match(r"[A-Za-z0-9._-]+", r) for r in found.requires or () if "extra ==" not in r]
    return found.version, tuple(m[0].lower() for m in needed if m)


@functools.cache
def _told_by(name: str) -> str:
    """The file that tells the version of a library; another version brings another file."""
    try:
        folder = getattr(metadata.distribution(NAMES.get(name, name)), "_path", None)
    except (metadata.PackageNotFoundError, ValueError):
        return ""
    return str(folder / "METADATA") if isinstance(folder, Path) else ""


@functools.cache
def _accelerator() -> dict[str, str]:
    """JAX runs on an accelerator where there is one, and then rounds as that does."""
    plugins = sorted(
        f"{d.name} {d.version}"
        for d in metadata.distributions(path=_site())
        if re.match(r"jax[-_](cuda|rocm|metal|tpu)|libtpu", d.name or "")
    )
    driver = Path("/proc/driver/nvidia/version")
    return (
        {
            "accelerator": "; ".join(plugins)
            + (f"; {driver.read_text().splitlines()[0]}" if driver.exists() else "")
        }
        if plugins
        else {}
    )


def _site() -> list[str]:
    import sys

    return [p for p in sys.path if p.endswith("-packages")]


@functools.cache
def processor() -> str:
    """What decides which instructions numpy, BLAS and compilers choose, and so how they round:
    model and features. Another one may differ in the last digit, and its seconds are another
    machine's."""
    lines = set()
    try:
        lines = {
            line
            for line in Path("/proc/cpuinfo").read_text().splitlines()
            if line.startswith(("flags", "Features", "model name", "CPU part"))
        }
    except OSError:
        pass
    model = next(
        (line.partition(":")[2].strip() for line in sorted(lines) if line.startswith("model name")),
        platform.processor(),
    )
    libc = (
        os.confstr("CS_GNU_LIBC_VERSION")
        if "CS_GNU_LIBC_VERSION" in getattr(os, "confstr_names", {})
        else ""
    )
    return (
        f"{platform.machine()} {model} {_digest(''.join(sorted(lines)).encode())[:8]} {libc}"
    ).strip()


def _with_side_effects() -> list[str]:
    """Files that do more than define when they are imported. All solvers and cases are imported to
    be found, so such a file counts for every run, whatever its own name."""
    found = import_graph.dependencies(
        *locations.plugin_files("solvers").values(),
        *locations.plugin_files("cases").values(),
        top=True,
    )
    return sorted(p for p in found.files if import_graph.has_import_side_effects(Path(p)))


def _digest(*chunks: bytes) -> str:
    h = hashlib.sha256()
    for c in chunks:
        h.update(len(c).to_bytes(8, "little") + c)
    return h.hexdigest()
