"""Which files of the package hold compiled kernels, and where numba stores what it made of them.

numba itself is not imported: a plan asks whether kernels are stored before anything is compiled.
"""

from __future__ import annotations

import hashlib
import os
import re
from pathlib import Path

from nsbench.source_files.locations import ROOT

KERNEL_FOLDERS = ("kernels", "linalg", "lcp")  # whatever lies below these is a kernel file
# what kernels take from the folder `compilation`
FOR_KERNELS = tuple(
    f"compilation/{name}.py"
    for name in (
        "borrowed_arrays", "decorators", "function_pointer", "inner_compiler", "library_functions",
    )
)
COMPILES = re.compile(rb"^from nsbench\.compilation\.decorators import", re.M)


def kernel_files() -> list[Path]:
    """Return the files whose content may be part of a compiled kernel, sorted.

    These are all files in a folder of kernels, constants included, and every other file that
    compiles. Such files import from one another alone; tests/compilation/test_callees.py shows it.
    """
    return [p for p in sorted(ROOT.rglob("*.py")) if _is_kernel_file(p)]


def _is_kernel_file(path: Path) -> bool:
    place = path.relative_to(ROOT)
    return (
        bool({*KERNEL_FOLDERS} & {*place.parts[:-1]})
        or place.as_posix() in FOR_KERNELS
        or COMPILES.search(path.read_bytes()) is not None
    )


def has_stored_kernels(folder: Path) -> bool:
    """Is some kernel below a folder of this package stored? True where there is none to store."""
    files = {p.parent: p for p in kernel_files() if folder in p.parents}.values()
    stores = [store for p in files for store in stores_of(p, os.environ.get("NUMBA_CACHE_DIR"))]
    return not files or any(next(store.glob("*.nbi"), None) is not None for store in stores)


def stores_of(file: Path, chosen: str | None) -> list[Path]:
    """Return the folders in which numba may store the kernels of a file.

    chosen: NUMBA_CACHE_DIR, or None. Source: the locators of numba/core/caching.py.
    """
    parent = file.parent
    digest = hashlib.sha1(str(parent).encode(), usedforsecurity=False).hexdigest()
    name = f"{parent.name}_{digest}"
    if chosen:
        return [Path(chosen) / name]
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return [parent / "__pycache__", Path(home) / "numba" / name]
