"""The processor and the installed libraries that this process computes with."""

from __future__ import annotations

import functools
import hashlib
import os
import platform
import re
from importlib import metadata
from pathlib import Path

# distributions whose name is not that of the import
DISTRIBUTIONS = {"flint": "python-flint", "sklearn": "scikit-learn", "yaml": "PyYAML"}
NOT_INSTALLED = "not installed"


@functools.cache
def processor() -> str:
    """Describe the processor by architecture, model, features and C library.

    These decide which instructions numpy, BLAS and compilers choose, and so how they round: on
    another processor the last digit may differ, and seconds are those of another machine.
    """
    lines = _cpuinfo()
    model = processor_model()
    names = getattr(os, "confstr_names", {})
    libc = os.confstr("CS_GNU_LIBC_VERSION") if "CS_GNU_LIBC_VERSION" in names else ""
    features = hashlib.sha256("".join(sorted(lines)).encode()).hexdigest()[:8]
    return f"{platform.machine()} {model} {features} {libc}".strip()


@functools.cache
def processor_model() -> str:
    """Return the name that the maker gives the processor; "" where the system does not tell."""
    models = [x.partition(":")[2].strip() for x in _cpuinfo() if x.startswith("model name")]
    return min(models, default=platform.processor())


def _cpuinfo() -> set[str]:
    """Return the lines of /proc/cpuinfo that tell model and features, each once."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return set()
    names = ("flags", "Features", "model name", "CPU part")
    return {line for line in lines if line.startswith(names)}


def machine() -> str:
    """Describe what machine code is for: the processor, the number of cores, this Python."""
    return f"{processor()} {os.cpu_count()} {platform.python_version()}"


@functools.cache
def version(name: str) -> str:
    """Return the version of a library by the name of its import, or `NOT_INSTALLED`."""
    found = _distribution(name)
    return NOT_INSTALLED if found is None else found.version


@functools.cache
def requirements(name: str) -> tuple[str, ...]:
    """Return the names of the libraries that a library needs itself, extras apart."""
    found = _distribution(name)
    needed = [] if found is None else [r for r in found.requires or () if "extra ==" not in r]
    matches = [re.match(r"[A-Za-z0-9._-]+", r) for r in needed]
    return tuple(m[0].lower() for m in matches if m)


@functools.cache
def metadata_file(name: str) -> str:
    """Return the file that holds the version of a library (another version brings another file);
    "" where there is none."""
    folder = getattr(_distribution(name), "_path", None)
    return str(folder / "METADATA") if isinstance(folder, Path) else ""


def _distribution(name: str) -> metadata.Distribution | None:
    try:
        return metadata.distribution(DISTRIBUTIONS.get(name, name))
    except (metadata.PackageNotFoundError, ValueError):
        return None
