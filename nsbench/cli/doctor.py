"""`nsbench doctor`: is this installation fit to measure with?

Each check yields a verdict (fine, warning or fault) and a sentence: Python, libraries, cases and
solvers, floating-point arithmetic, cache folders, machine, stored references, and two small runs
against a known solution.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path

import numpy as np

from nsbench.cli import exit_codes

FINE = "fine"
WARNING = "warning"
FAULT = "fault"
EXTRAS = {
    "python-flint": "certified references",
    "nosnoc": "the nosnoc baseline",
    "casadi": "the nosnoc baseline",
}
# bytes: kernels, programs and the results of a standard suite take that together
DISK_SPACE_NEEDED = 500 << 20
MAX_LISTED = 10  # files of one kind that are not as they were written; the others are counted
MAX_LOAD_PER_CORE = 0.5  # above it the seconds of runs are noisy
Finding = tuple[str, str]


def command(args: argparse.Namespace, say: Callable[[str], None]) -> int:
    """Print the finding of every check; 5 if one of them is a fault."""
    faults = 0
    for verdict, sentence in examine():
        say(f"{verdict:<8} {sentence}")
        faults += verdict == FAULT
    if not faults:
        say("nothing stands in the way")
        return exit_codes.FINE
    say(f"{faults} fault(s): numbers of this installation are not to be trusted")
    return exit_codes.BROKEN


def examine() -> Iterator[Finding]:
    """Examine the installation; yields (verdict, sentence) of every check, one by one.

    What a check raises, whatever it came across, is a fault with a sentence, and the next ones are
    made.
    """
    for check in (
        _check_python,
        _check_libraries,
        _check_plugins,
        _check_arithmetic,
        _check_folders,
        _check_caches,
        _check_machine,
        _check_references,
        _check_solutions,
    ):
        try:
            yield from check()
        except Exception as e:
            what = check.__name__.removeprefix("_check_")
            yield FAULT, " ".join(f"{what} cannot be examined: {type(e).__name__}: {e}".split())


def _check_python():
    bits = 64 if sys.maxsize > 2**32 else 32
    suitable = sys.version_info >= (3, 11) and bits == 64
    yield (
        FINE if suitable else FAULT,
        f"Python {sys.version.split()[0]}, {bits} bits"
        + ("" if suitable else "; 3.11 with 64 is needed"),
    )


def _check_libraries():
    from packaging.requirements import Requirement

    for text in metadata.requires("nsbench") or ():
        wanted = Requirement(text)
        if wanted.marker is not None and not wanted.marker.evaluate({"extra": ""}):
            continue
        try:
            version = metadata.version(wanted.name)
        except metadata.PackageNotFoundError:
            yield FAULT, f"{wanted.name} is not installed ({wanted.specifier} is needed)"
            continue
        good = wanted.specifier.contains(version, prereleases=True)
        yield (
            FINE if good else FAULT,
            f"{wanted.name} {version}" + ("" if good else f"; {wanted.specifier} is needed"),
        )
    for name, use in EXTRAS.items():
        try:
            yield FINE, f"{name} {metadata.version(name)}"
        except metadata.PackageNotFoundError:
            yield FINE, f"{name} is not installed: {use} will be refused"


def _check_plugins():
    from nsbench import solvers
    from nsbench.case import broken_cases, case_names

    broken = {
        **{f"case {k}": v for k, v in broken_cases().items()},
        **{f"solver {k}": v for k, v in solvers.broken().items()},
    }
    for name, why in broken.items():
        yield FAULT, f"{name} does not load: {why}"
    if not broken:
        yield FINE, f"{len(case_names())} cases and {len(solvers.all_names())} solvers load"


def _check_arithmetic():
    """Check that subnormal numbers are not flushed to zero.

    A library built with unsafe options sets the processor so, for everything in the process.
    """
    import nsbench.compilation.numba_cache  # noqa: F401

    tiny = np.float64(5e-324)
    subnormal = tiny * np.float64(1.0) > 0.0 and np.float64(2.3e-308) / np.float64(4.0) > 0.0
    if subnormal:
        yield FINE, "numbers below 1e-308 are kept"
    else:
        yield (
            FAULT,
            "numbers below 1e-308 become zero: a library was built with -ffast-math; results will "
            "differ",
        )


def _check_folders():
    import shutil

    from nsbench.compilation.disk_cache import user_cache_folder

    named = os.environ.get("NUMBA_CACHE_DIR")
    kernels = Path(named) if named else Path(__file__).resolve().parents[1]
    user = user_cache_folder()
    for folder, use in ((kernels, "compiled kernels"), (user, "compiled programs")):
        if _is_writable(folder):
            yield FINE, f"{use} are kept in {folder}"
        else:
            yield (
                WARNING,
                f"{folder} cannot be written: {use} are kept elsewhere, or made anew by every "
                f"process",
            )
    free = shutil.disk_usage(tempfile.gettempdir()).free
    yield (
        FINE if free > DISK_SPACE_NEEDED else WARNING,
        f"{free >> 20} MiB free for temporary files",
    )


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _check_caches():
    """Look for stored machine code that is damaged: it is not run, and compiled again."""
    from nsbench.compilation import disk_cache, numba_cache

    folders = [disk_cache.user_cache_folder() / kind for kind in ("pointers", "programs")]
    faults = {
        "compiled kernels": numba_cache.stored_kernel_faults(),
        "compiled programs": [f for folder in folders for f in disk_cache.faults_in(folder)],
    }
    for use, found in faults.items():
        for fault in found[:MAX_LISTED]:
            yield WARNING, f"{fault}: it is compiled again"
        if len(found) > MAX_LISTED:
            yield WARNING, f"{len(found) - MAX_LISTED} more files of {use} are compiled again"
        if not found:
            yield FINE, f"{use} are as they were written"


def _check_machine():
    import psutil

    cores = os.cpu_count() or 1
    load = psutil.getloadavg()[0]
    yield (
        FINE if load < MAX_LOAD_PER_CORE * cores else WARNING,
        f"{cores} cores, load {load:.1f}"
        + ("" if load < MAX_LOAD_PER_CORE * cores else ": seconds will be noisy, errors will not"),
    )
    import jax

    yield FINE, f"JAX computes on {', '.join(sorted({d.platform for d in jax.devices()}))}"


def _check_references():
    from nsbench.case import get_case
    from nsbench.reference import load
    from nsbench.study.plan import suite_cases

    good = 0
    for key in suite_cases("full"):
        case = get_case(key)
        try:
            good += load(case) is not None
        except ValueError as e:
            yield FAULT, f"the stored reference of {key} cannot be used: {e}"
    yield FINE, f"{good} stored references are whole and belong to their cases"


def _check_solutions():
    """Solve a case with a known solution by two methods of different kinds."""
    from nsbench.case import get_case
    from nsbench.measure import errors
    from nsbench.solvers import solve

    case = get_case("tide")
    for spec, accuracy, bound in (("pbd", {"h": 1e-3}, 1e-3), ("event_driven", {}, 1e-10)):
        traj = solve(case, spec, **accuracy)
        error = errors(case, traj)["state_sup"] if traj.status.ok else np.nan
        yield (
            FINE if error <= bound else FAULT,
            f"{spec} on tide: {traj.status.code}, error {error:.1e} (at most {bound:g})",
        )
