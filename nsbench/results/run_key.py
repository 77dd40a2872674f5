"""Key under which a run is stored: a digest of everything that can change its numbers.

key = digest(case, solver, accuracy, value, start_seed; common part, solver part, case part)

Each part is a list of items with their digests or values:

    common   the whole nsbench package as one item, versions of the numerical libraries, Python,
             settings in the environment, the processor
    solver   a user's solver file, what it imports or opens as it is loaded, variables it looks up
    case     the case file, likewise, and its stored reference

Editing a file of the package makes every run again; editing a user's file makes those runs again
that depend on it (nsbench.source_files.user_imports). Parts are stored with the row, so that
`nsbench run --plan` can say which item made a row stale. What runs read themselves is known after
them alone, and is compared before a row is reused (nsbench.results.row_reuse).
"""

from __future__ import annotations

import functools
import json
import os
import platform
import re
import sys
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

from nsbench.case import parse_spec
from nsbench.compilation import disk_cache
from nsbench.compilation.machine_and_libraries import (
    metadata_file,
    processor,
    requirements,
    version,
)
from nsbench.source_files import (
    environment_reads,
    file_state,
    locations,
    opened_files,
    package,
    user_imports,
)
from nsbench.source_files.environment_reads import HARMLESS

if TYPE_CHECKING:
    from nsbench.case import Case
    from nsbench.study.plan import Spec

SHORT = 16  # hexadecimal digits of a digest within a key
PACKAGE = "nsbench"  # item: digest of the whole package
UNSET = "unset"  # in the place of a value
VARIABLE = "environment variable "  # begins an item: a variable that a user's file looks up
LOADER = ("GLIBC_TUNABLES", "LD_PRELOAD", "LD_LIBRARY_PATH")  # settings of the dynamic loader
SETTINGS = {
    "numpy": ("NPY_", "OPENBLAS_", "MKL_", "BLIS_", "VECLIB_", "OMP_", "KMP_"),
    "numba": ("NUMBA_",),
    "jax": ("JAX_", "XLA_", "CUDA_", "HIP_", "ROCR_", "TF_XLA"),
}
# libraries of whose code numbers of the package's own methods are made
NUMERICAL = (
    "numpy",
    "scipy",
    "numba",
    "llvmlite",
    "jax",
    "jaxlib",
    "ml_dtypes",
    "opt_einsum",
    "diffrax",
    "equinox",
    "lineax",
    "optimistix",
    "osqp",
    "piqp",
    "nosnoc",
    "casadi",
)


@dataclass(frozen=True)
class Part:
    """Items of one part by name; digest: sixteen hexadecimal digits of them all."""

    items: tuple[tuple[str, str], ...]
    digest: str

    @classmethod
    def of(cls, items: dict[str, str]) -> Part:
        """Make a part of items by name."""
        pairs = tuple(sorted(items.items()))
        return cls(pairs, disk_cache.digest(json.dumps(pairs))[:SHORT])


def key_of(spec: Spec, parts: tuple[Part, ...]) -> str:
    """Return the key of a run: 64 hexadecimal digits."""
    requested = [spec.case, spec.solver, spec.accuracy, repr(float(spec.asked)), spec.start_seed]
    return disk_cache.digest(json.dumps([requested, [p.digest for p in parts]]))


def parts_of(spec: Spec, case: Case) -> tuple[Part, ...]:
    """Return what a run of the case depends on: common part, solver part, case part."""
    return (
        _common_part(),
        _solver_part(spec.solver, spec.solver_files),
        _case_part(case.source, _stored_references(case)),
    )


def dependency_files(spec: Spec, case: Case) -> frozenset[str]:
    """Return the paths of all files that a run depends on.

    These are the package, what user files import and open, stored references, whether they exist
    or not, and the metadata of libraries, which tell their versions.
    """
    from nsbench.reference.storage import files_of

    return _dependency_files(
        spec.solver, spec.solver_files, case.source, tuple(str(f) for f in files_of(case))
    )


def user_files(*paths: str) -> list[str]:
    """Return all files that case or solver files depend on and that neither this package nor a
    library brings, themselves included."""
    return sorted(p for p in _with_opened(*paths).files if locations.is_user_file(p))


def forget() -> None:
    """Read all files again from now on: for a process that outlives an edit."""
    user_imports.forget()
    package.forget()
    file_state.forget()
    for f in (_common_part, _solver_part, _case_part, _content, _dependency_files):
        f.cache_clear()


@functools.cache
def _dependency_files(
    solver: str, solver_files: tuple[str, ...], source: str, references: tuple[str, ...]
) -> frozenset[str]:
    found = _solver_dependencies(solver, solver_files), _case_dependencies(source)
    libraries = {*NUMERICAL, *_with_requirements({name for f in found for name in f.libraries})}
    versions = filter(None, map(metadata_file, libraries))
    files = frozenset({*references, *versions, *package.package_files()})
    return files.union(user_imports.cases_with_side_effects(), *(f.files for f in found))


@functools.cache
def _common_part() -> Part:
    items = {PACKAGE: package.package_digest()[:SHORT], "python": platform.python_version()}
    items |= _contents(user_imports.cases_with_side_effects(), locations.ROOT)
    items |= _libraries(NUMERICAL)
    items |= {
        f"setting {k}": v
        for k, v in os.environ.items()
        if k in LOADER or (k.startswith("NSBENCH_") and not HARMLESS.match(k))
    }
    return Part.of(items | {"processor": processor()})


def _solver_dependencies(spec: str, solver_files: tuple[str, ...]) -> user_imports.Dependencies:
    """Follow the user's file of a solver, and those of others that its options name."""
    name, options = parse_spec(spec)
    known = {Path(f).stem: f for f in solver_files}
    named = dict.fromkeys(known[n] for n in (name, *map(str, options.values())) if n in known)
    return _with_opened(*named)


@functools.cache
def _solver_part(spec: str, solver_files: tuple[str, ...]) -> Part:
    found = _solver_dependencies(spec, solver_files)
    name = parse_spec(spec)[0]
    file = next((f for f in solver_files if Path(f).stem == name), "")
    return _user_part(found, Path(file).resolve().parent if file else locations.ROOT)


def _case_dependencies(source: str) -> user_imports.Dependencies:
    return _with_opened(*filter(None, [source]))


@functools.cache
def _case_part(source: str, references: tuple[str, ...]) -> Part:
    found = _case_dependencies(source)
    return _user_part(found, Path(source).resolve().parent, references)


def _user_part(
    found: user_imports.Dependencies, folder: Path, references: tuple[str, ...] = ()
) -> Part:
    """Make a part of files, libraries and variables; `folder` is where their paths begin."""
    variables = environment_reads.looked_up_while_loading(found.files)
    return Part.of(
        _contents({*found.files, *references}, folder)
        | _libraries(_with_requirements(found.libraries))
        | {VARIABLE + name: variable_digest(value) for name, value in variables.items()}
    )


def variable_digest(value: str | None) -> str:
    """Return the digest of a variable's value, which itself is not written anywhere: it may be a
    secret."""
    return UNSET if value is None else disk_cache.digest(value)[:SHORT]


def _with_opened(*paths: str) -> user_imports.Dependencies:
    """Follow files and those that they opened while they were loaded."""
    opened = {
        p
        for path in paths
        for p in opened_files.opened_while_loading(path)
        if locations.is_user_file(p)
    }
    return user_imports.dependencies(*paths, *sorted(opened))


def _stored_references(case) -> tuple[str, ...]:
    from nsbench.reference.storage import files_of

    files = [str(f) for f in files_of(case)]
    for f in files:
        file_state.record_state(f)
    return tuple(f for f in files if os.path.exists(f))


def _contents(paths, folder: Path) -> dict[str, str]:
    """Return digests by the path within the package, or from the folder of the user's file."""
    contents = {}
    for path in paths:
        p = Path(path)
        name = Path(os.path.relpath(p, folder)).as_posix()
        for home, place in sorted(locations.package_folders().items()):
            if p.is_relative_to(place):
                name = f"{home.replace('.', '/')}/{p.relative_to(place).as_posix()}"
        contents[name] = _content(path)
    return contents


@functools.cache
def _content(path: str) -> str:
    file_state.record_state(path)
    return file_state.digest(path)


def _libraries(names) -> dict[str, str]:
    """Return the versions of libraries, and the settings in the environment that they read."""
    versions = {}
    for name in names:
        versions[name] = version(name)
        if file := metadata_file(name):
            file_state.record_state(file)
    prefixes = tuple(p for library, ps in SETTINGS.items() if library in versions for p in ps)
    settings = {
        f"setting {k}": v
        for k, v in os.environ.items()
        if prefixes and k.startswith(prefixes) and not HARMLESS.match(k)
    }
    return versions | settings | (_accelerator() if "jax" in versions else {})


def _with_requirements(names) -> list[str]:
    """Return the libraries and all that they need, and those need, and so on."""
    to_visit = sorted(names)
    found: list[str] = []
    while to_visit:
        name = to_visit.pop()
        if name not in found:
            found.append(name)
            to_visit += requirements(name)
    return found


@functools.cache
def _accelerator() -> dict[str, str]:
    """Describe the accelerator on which JAX runs where there is one, and rounds as that does."""
    site = [p for p in sys.path if p.endswith("-packages")]
    plugins = sorted(
        f"{d.name} {d.version}"
        for d in metadata.distributions(path=site)
        if re.match(r"jax[-_](cuda|rocm|metal|tpu)|libtpu", d.name or "")
    )
    if not plugins:
        return {}
    driver = Path("/proc/driver/nvidia/version")
    lines = [driver.read_text().splitlines()[0]] if driver.exists() else []
    return {"accelerator": "; ".join([*plugins, *lines])}
