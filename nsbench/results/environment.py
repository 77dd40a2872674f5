"""Versions and machine of a study, for DIR/env.json."""

from __future__ import annotations

import functools
import os
import platform
import sys

import nsbench
from nsbench.compilation.machine_and_libraries import NOT_INSTALLED, version
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


def environment(**more: object) -> dict:
    """Return versions, machine, load and command line, with further entries, for env.json."""
    load = os.getloadavg() if hasattr(os, "getloadavg") else ()
    return {
        "schema": SCHEMA,
        "versions": versions() | {"nsbench": nsbench.__version__},
        "platform": platform.platform(),
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "load": [round(v, 2) for v in load],
        "argv": sys.argv[1:],
        "package": package_digest()[:16],
        **more,
    }
