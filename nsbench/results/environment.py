"""Versions and machine of a study, for DIR/env.json."""

from __future__ import annotations

import functools
import os
import platform
import sys
from collections.abc import Sequence
from datetime import UTC, datetime

import nsbench
from nsbench.compilation.machine_and_libraries import NOT_INSTALLED, processor_model, version
from nsbench.results.journal import SCHEMA
from nsbench.source_files.package import package_digest

LIBRARIES = (
    "numpy",
    "scipy",
    "numba",
    "llvmlite",
    "jax",
    "jaxlib",
    "diffrax",
    "equinox",
    "osqp",
    "piqp",
    "nosnoc",
    "casadi",
)


@functools.cache
def versions() -> dict[str, str]:
    """Return the versions of Python and of the libraries that are installed, by name."""
    found = {name: version(name) for name in LIBRARIES}
    return {"python": platform.python_version()} | {
        name: v for name, v in found.items() if v != NOT_INSTALLED
    }


def start_of_runs(argv: Sequence[str] | None = None) -> dict:
    """Return what `environment` notes of when runs begin: date and load of now, and the command.

    argv: of the command with the options that nsbench.toml gave; None: that of the process.
    """
    command = {} if argv is None else {"argv": list(argv)}
    return {"began": _now(), "load_at_start": _load(), **command}


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _load() -> list[float]:
    """Return the load averages over 1, 5 and 15 minutes; [] where the system has none."""
    return [round(v, 2) for v in os.getloadavg()] if hasattr(os, "getloadavg") else []


def environment(**more: object) -> dict:
    """Return versions, machine, load and command line, with further entries, for env.json.

    load: of now, when the entries are written. more: such as those of `start_of_runs`.
    """
    return {
        "schema": SCHEMA,
        "versions": versions() | {"nsbench": nsbench.__version__},
        "platform": platform.platform(),
        "machine": platform.machine(),
        "processor": processor_model(),
        "cores": os.cpu_count(),
        **more,
        "written": _now(),
        "load": _load(),
        "argv": sys.argv[1:],
        "package": package_digest()[:16],
    }
